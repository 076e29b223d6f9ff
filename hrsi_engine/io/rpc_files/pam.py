"""GDAL's own side file ``<image>.aux.xml`` (PAM): metadata domain ``RPC``."""

from .content import read_xml, xml_bytes


def read_domain(path: str, domain: str) -> dict[str, str]:
    """Return one metadata domain of the dataset (not of its bands), empty where there is none.

    Raises `InputError` where the file is not well-formed XML.
    """
    for element in read_xml(path).findall("Metadata"):
        if element.get("domain") == domain:
            return {item.get("key", ""): item.text or "" for item in element.findall("MDI")}
    return {}


def without_domain(path: str, domain: str) -> bytes:
    """Return the content of a ``.aux.xml`` file with one metadata domain left out."""
    root = read_xml(path)
    for element in root.findall("Metadata"):
        if element.get("domain") == domain:
            root.remove(element)
    return xml_bytes(root)

"""Icons of the provider and of its algorithms, one ``NAME.svg`` each."""

from pathlib import Path

_FOLDER = Path(__file__).parent


def icon_path(algorithm: str = "hrsi") -> Path:
    """Return the icon of an algorithm, or that of the provider if it has none."""
    own = _FOLDER / f"{algorithm}.svg"
    return own if own.exists() else _FOLDER / "hrsi.svg"

"""Tie points of other programs: MicMac's PMUL files, ASP's match files, and how several files are named."""

import struct
from pathlib import Path

import numpy as np
import pytest

from hrsi.hrsi_engine.foundation.errors import InputError
from hrsi.hrsi_engine.io.point_files import read_points, several_specs
from hrsi.processing_algorithms.block_steps.inputs import join_image_points


def write_match(path: Path, left: np.ndarray, right: np.ndarray, descriptors: int = 0) -> str:
    """Write a match file as the manual's script does, field by field; descriptors of unequal length."""
    with open(path, "wb") as out:
        out.write(struct.pack("q", len(left)) + struct.pack("q", len(right)))
        for table in (left, right):
            for number, (x, y) in enumerate(table):
                out.write(
                    struct.pack("f", x) + struct.pack("f", y) + struct.pack("i", int(x)) + struct.pack("i", int(y))
                )
                out.write(
                    struct.pack("f", 0.1) + struct.pack("f", 1.0) + struct.pack("f", 5.0) + struct.pack("?", True)
                )
                length = descriptors and descriptors + number
                out.write(struct.pack("I", 0) + struct.pack("I", 1) + struct.pack("Q", length))
                out.write(struct.pack(f"{length}f", *range(length)))
    return str(path)


def test_damaged_match_files_are_refused(tmp_path):
    path = Path(write_match(tmp_path / "run-a__b.match", np.ones((3, 2)), np.ones((3, 2)), 2))
    content = path.read_bytes()
    for damaged in (content[:-1], content[:10], content + b"x", struct.pack("<QQ", 2**60, 2**60), b"", content[:20]):
        path.write_bytes(damaged)
        with pytest.raises(InputError, match="no complete match file"):
            read_points(str(path), image_ids=["a", "b"])
    path.write_bytes(content.replace(struct.pack("f", 1.0), struct.pack("f", np.nan)))
    with pytest.raises(InputError, match="no numbers"):
        read_points(str(path), image_ids=["a", "b"])
    (tmp_path / "run-a__b.txt").write_text("1 2 3 4 5 6\n1 2 3\n")
    with pytest.raises(InputError, match="six numbers a line"):
        read_points(str(tmp_path / "run-a__b.txt"), image_ids=["a", "b"])
    other = tmp_path / "matches.match"
    other.write_bytes(content)
    with pytest.raises(InputError, match="rename it to PREFIX-IMAGE1__IMAGE2"):
        read_points(str(other), image_ids=["a", "b"])


def test_matches_of_pairs_become_tracks(tmp_path):
    """a-b and b-c share positions on b; one track meets image c twice and is left out."""
    rng = np.random.default_rng(1)
    a, b, c = (np.round(rng.uniform(0, 1000, (6, 2)), 3).astype(np.float32) for _ in range(3))
    tables = [
        read_points(write_match(tmp_path / name, left, right), image_ids=["a", "b", "c"]).image
        for name, left, right in (
            ("r-a__b.match", a[:5], b[:5]), ("r-b__c.match", b[2:6], c[2:6]),
            ("r-a__c.match", a[[0, 4]], c[[0, 5]]),  # the second contradicts: a4 - b4 - c4, and a4 - c5 - b5
        )
    ]  # fmt: skip
    found = join_image_points(tables)
    tracks: dict[str, set] = {}
    for name, image, xy in zip(found.ids.tolist(), found.image_ids.tolist(), found.xy.tolist(), strict=True):
        tracks.setdefault(name, set()).add((image, tuple(xy)))
    point = {"a": a, "b": b, "c": c}
    expected = [
        {(image, tuple(point[image][k].astype(float).tolist())) for image in images}
        for k, images in ((0, "abc"), (1, "ab"), (2, "abc"), (3, "abc"))
    ]
    assert sorted(map(sorted, tracks.values())) == sorted(map(sorted, expected))


def write_pmul(path: Path, rows: str = "10.5,20.5,0\n11,21,7\n") -> str:
    path.write_text("Pt.x,Pt.y,Id\n" + rows)
    return str(path)


def test_micmac_counts_from_the_corner(tmp_path):
    path = write_pmul(tmp_path / "PMUL-SPOT_1A.tif.csv")
    image = read_points(path, image_ids=["SPOT_1A", "SPOT_1B"]).image
    assert image.ids.tolist() == ["0", "7"]
    assert image.image_ids.tolist() == ["SPOT_1A", "SPOT_1A"]
    assert image.xy.tolist() == [[10.0, 20.0], [10.5, 20.5]]


def test_the_image_may_be_named_behind_the_file(tmp_path):
    path = write_pmul(tmp_path / "PMUL-SPOT_1A.tif.csv")
    image = read_points(f"{path}|image=RPC_1A", image_ids=["RPC_1A", "RPC_1B"]).image
    assert image.image_ids.tolist() == ["RPC_1A", "RPC_1A"]
    with pytest.raises(InputError, match=r"image=RPC_1C is not in the block \(images: RPC_1A, RPC_1B\)"):
        read_points(f"{path}|image=RPC_1C", image_ids=["RPC_1A", "RPC_1B"])
    other = write_pmul(tmp_path / "ties.csv")
    assert read_points(f"{other}|image=x", image_ids=["x", "y"]).image.image_ids[0] == "x"
    with pytest.raises(InputError, match="has no field 'image'"):
        read_points(other, image_ids=["x", "y"])
    named = tmp_path / "named.csv"
    named.write_text("id,image,sample,line\nA,x,1,2\n")
    with pytest.raises(InputError, match=r"remove \|image="):
        read_points(f"{named}|image=y", image_ids=["x", "y"])


def test_damaged_pmul_names_the_line(tmp_path):
    path = write_pmul(tmp_path / "PMUL-a.csv", "1,2,0\n3,x,1\n")
    with pytest.raises(InputError, match=r"PMUL-a.csv.*line 3.*'x' is not a number"):
        read_points(path, image_ids=["a"])


def write_homol(path: Path, rows: list[list[float]]) -> bytes:
    path.parent.mkdir(parents=True, exist_ok=True)
    content = struct.pack("<ii", 2, len(rows)) + b"".join(struct.pack("<id4d", 2, 1.0, *row) for row in rows)
    path.write_bytes(content)
    return content


def test_homol_pairs_are_taken_once_and_count_from_the_corner(tmp_path):
    """Both directions of a pair, one with a match more; the text of a pair that has a binary file is not read."""
    homol = tmp_path / "Homol"
    write_homol(homol / "Pastisb.tif" / "a.tif.dat", [[10.5, 20.5, 1.5, 2.5], [30.0, 40.0, 3.0, 4.0]])
    write_homol(homol / "Pastisa.tif" / "b.tif.dat", [[1.5, 2.5, 10.5, 20.5]])
    (homol / "Pastisa.tif" / "b.tif.txt").write_text("7 7 7 7 1\n")
    (homol / "Pastisa.tif" / "c.tif.txt").write_text("5.5 6.5 7.5 8.5 1.000000\n\n9.5 1.5 2.5 3.5\n")
    write_homol(homol / "Pastisc.tif" / "a.tif.dat", [])
    tables = read_points(str(homol), image_ids=["a", "b", "c"])
    assert tables.pairwise
    rows = zip(tables.image.image_ids.tolist(), map(tuple, tables.image.xy.tolist()), strict=True)
    assert sorted(rows) == [
        ("a", (1.0, 2.0)), ("a", (2.5, 3.5)), ("a", (5.0, 6.0)), ("a", (9.0, 1.0)),
        ("b", (10.0, 20.0)), ("b", (29.5, 39.5)), ("c", (2.0, 3.0)), ("c", (7.0, 8.0)),
    ]  # fmt: skip
    found = dict(zip(tables.image.xy[:, 0].tolist(), tables.image.ids.tolist(), strict=True))
    assert found[1.0] == found[10.0] and found[2.5] == found[29.5] and found[5.0] == found[7.0] != found[9.0]


def test_damaged_homol_files_are_refused(tmp_path):
    path = tmp_path / "Homol" / "Pastisa.tif" / "b.tif.dat"
    content = write_homol(path, [[1.0, 2.0, 3.0, 4.0], [5.0, 6.0, 7.0, 8.0]])
    wrong = struct.pack("<i", 3)
    for damaged in (
        content[:-1], content[:7], content[:-44], content + b"x", content[:8] + wrong + content[12:],
        content.replace(struct.pack("<d", 6.0), struct.pack("<d", np.nan)),
    ):  # fmt: skip
        path.write_bytes(damaged)
        for named in (path, tmp_path / "Homol"):
            with pytest.raises(InputError, match=r"b\.tif\.dat: is no complete file of MicMac's matches"):
                read_points(str(named), image_ids=["a", "b"])
    text = tmp_path / "Homol" / "Pastisa.tif" / "c.tif.txt"
    path.unlink()
    for damaged in ("1 2 3\n", "1 2 3 x 1\n", "1 2 3 inf\n"):
        text.write_text(damaged)
        with pytest.raises(InputError, match=r"c\.tif\.txt: is no complete file"):
            read_points(str(tmp_path / "Homol"), image_ids=["a", "c"])


def test_several_files(tmp_path):
    first, second = (write_pmul(tmp_path / f"PMUL-{name}.tif.csv") for name in "ab")
    assert several_specs(str(tmp_path / "PMUL-*.csv")) == [first, second]
    assert several_specs(f"{first}|image=x;{second}|image=y") == [f"{first}|image=x", f"{second}|image=y"]
    odd = tmp_path / "a;b[1].csv"
    odd.write_text("id,image,sample,line\n")
    assert several_specs(str(odd)) == [str(odd)]
    with pytest.raises(InputError, match="no file has such a name"):
        several_specs(str(tmp_path / "nothing*.csv"))
    assert several_specs("missing.csv") == ["missing.csv"]  # reading it says so

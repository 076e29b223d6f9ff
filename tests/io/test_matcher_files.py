"""Matches of COLMAP and hloc: keypoints in each one's pixels, which matches count, what damaged files say."""

import base64
import sqlite3
import zlib
from pathlib import Path

import numpy as np
import pytest
from colmap_database import write_database

from hrsi.hrsi_engine.foundation.errors import InputError
from hrsi.hrsi_engine.io.point_files import read_points

IDS = ["a", "b", "c"]
#: Made with h5py 3 as hloc makes them (``libver="latest"``, half precision), compressed: ``a.tif`` with keypoints
#: (1.5, 2.25), (3, 4), (10, 20.5) and ``sub/b.tif`` with (5, 6), (7.25, 8); matches0 = 1, -1, 0 of the pair; and a
#: dense matcher's pair a.tif/b.tif with keypoints0 (1, 2), (3, 4.5), keypoints1 (5, 6), (7, 8.5), matches0 = 0, 1.
FEATURES, MATCHES, DENSE = (
    (
        "c-rgqaB<`1lHy|K;9!7(|4<+Y6*7Q|zqh(#>F?nZ#Kcg+B!sLG2Dq3Q7#SGY1Q>u6YocCBX4+<`RyID67;|xHk{>fv$cTXqAp8GY7%@%|0a?eH"
        "omyFtpP5%uY{m$6h9F3stvETqD7Dy$32LY|Nlv&hIoKHN1V#o%MimAICMHHkn4e%KV(>*67zGvhp?m=bE>;FEejtk#=vrnj4xmq%85y9V%>%P&"
        "0mGmNd17Y+;b8#`b6`-w!-AOvzw<!-&IU7h1H+I5ZGw^~iO(HLpxkj07Dg`Aal-9GXZ6X*9U&}Oaz_FyS-Hc}tn31M?qEX84NPR@4k2g?;TS@>"
        "<9FEm-RQZ49KTCJJ<T$NbI0_J3yw34g24yu8XOp$fCZ4Jf-i#&7`igJIk+=;fY<=LMT=J"
    ),
    (
        "c-rgqaB<`1lHy|K;9!7(|4_gK6*7Q|8$3I5$=|~zh>4+sNeEdX3~(_qFfuT(2`~UD)<nIM%(TrgGhG;{0wN}tE+NJVA|NMl7MCXJCV`w`#t7B#"
        "K)Dli>}}Q);{;)l6F71cOOi8Eiw$-{UBD&{5*7dpXXd5H7boWz0i};JK}}a8#tAQ~X1If$z{tSJ2=powBO@a-R1Qw_Ffa-LBM@S+00S$~Rm@x*"
        "Ko>IuodtCa%)lKCLlziFF>NOp79tFcf(rcbu;5~4;Nl0eki&!xJxn$Xy|7sD>zNC~C>RB!U=$Ds7=hInkg@<`D**OqWhw"
    ),
    (
        "c-rgqaB<`1lHy|K;9!7(|4^U-6*7Q|Ct9vP<?rDV#Kcg+B!sLG2Dq3Q7#SGY1Q>u6YocCBX4+<$nJx@e0TGi+mk{rSB#;x#7^&-o1D+0o#5h41"
        "<OGh~#FFHU)MA63P*<>tf`qxUQ!5MdGxJJ{4URHlmoU7@47HFS!wE{yXYB+#fsuicQG|hkiII^JY77I6X69jF6aYpb3z(<CzzTE~GZzQY#mqow"
        "LDaybd<Vmj1ucgyGT~vN0`xx<W>{c^jR*sypn^O+Y{WSj#Or}9<S>He2LYHx3kH8!{Q9z?nigRpF$BZnz(c!whEXsIMgbuJshS$>frJAP0r3PN"
        "UI4@gfcOCrb2tJ3k6Ljg"
    ),
)


def write_hdf5(path: Path, content: str) -> str:
    path.write_bytes(zlib.decompress(base64.b85decode(content)))
    return str(path)


KEYPOINTS = {
    "a.tif": np.array([[0.5, 0.5], [10.5, 20.75]]),
    "day/b.tif": np.array([[5.5, 6.5], [7.0, 8.0], [9.5, 9.5]]),
}


@pytest.mark.parametrize("name", ["database.db", "matches.sqlite", "renamed"])
def test_colmap_counts_from_the_corner(tmp_path, name):
    path = write_database(tmp_path / name, KEYPOINTS, {(1, 2): [[0, 2], [1, 0]]})
    tables = read_points(path, image_ids=IDS)
    assert tables.pairwise
    assert tables.image.image_ids.tolist() == ["a", "a", "b", "b"]
    np.testing.assert_array_equal(tables.image.xy, [[0.0, 0.0], [10.0, 20.25], [9.0, 9.0], [5.0, 6.0]])


def test_matches_that_colmap_verified_come_first(tmp_path):
    path = write_database(tmp_path / "database.db", KEYPOINTS, {(1, 2): [[0, 2], [1, 0]]}, {(1, 2): [[1, 1]]})
    np.testing.assert_array_equal(read_points(path, image_ids=IDS).image.xy, [[10.0, 20.25], [6.5, 7.5]])


def test_wrong_databases_say_what_is_wrong(tmp_path):
    nothing = write_database(tmp_path / "nothing.db", KEYPOINTS, {})
    beyond = write_database(tmp_path / "beyond.db", KEYPOINTS, {(1, 2): [[0, 3]]})
    unknown = write_database(tmp_path / "unknown.db", KEYPOINTS, {(1, 7): [[0, 1]]})
    other = tmp_path / "other.db"
    with sqlite3.connect(other) as database:
        database.execute("CREATE TABLE images (image_id INTEGER, name TEXT)")
    short = write_database(tmp_path / "short.db", KEYPOINTS, {(1, 2): [[0, 1]]})
    with sqlite3.connect(short) as database:
        database.execute("UPDATE matches SET rows = 2")
    for path, words in (
        (nothing, "contains no matches"),
        (beyond, "keypoints that are not there"), (unknown, "image 7 and no keypoints"),
        (str(other), "no database of COLMAP"), (short, "8 bytes for 2 x 2"),
    ):  # fmt: skip
        with pytest.raises(InputError, match=words) as error:
            read_points(path, image_ids=IDS)
        assert path in str(error.value)
    whole = Path(write_database(tmp_path / "whole.db", KEYPOINTS, {(1, 2): [[0, 1]]})).read_bytes()
    broken = tmp_path / "broken.db"
    broken.write_bytes(whole[: len(whole) // 2])
    with pytest.raises(InputError, match=r"broken\.db"):
        read_points(str(broken), image_ids=IDS)


def test_hloc_counts_from_the_centre(tmp_path):
    """Half precision, the image's folder in its name, and features that the matches' name leads to."""
    write_hdf5(tmp_path / "feats-superpoint.h5", FEATURES)
    path = write_hdf5(tmp_path / "feats-superpoint_matches-superglue_pairs.h5", MATCHES)
    tables = read_points(path, image_ids=IDS)
    assert tables.pairwise
    assert tables.image.image_ids.tolist() == ["a", "a", "b", "b"]
    np.testing.assert_array_equal(tables.image.xy, [[1.5, 2.25], [10.0, 20.5], [7.25, 8.0], [5.0, 6.0]])


def test_features_of_another_name(tmp_path):
    features = write_hdf5(tmp_path / "keypoints.h5", FEATURES)
    path = write_hdf5(tmp_path / "matches.h5", MATCHES)
    assert len(read_points(f"{path}|features={features}", image_ids=IDS).image) == 4
    with pytest.raises(InputError, match=r"matches\.h5\|features=FILE"):
        read_points(path, image_ids=IDS)
    with pytest.raises(InputError, match="no features of hloc"):
        read_points(f"{path}|features={path}", image_ids=IDS)
    with pytest.raises(InputError, match="contains no matches of hloc"):
        read_points(features, image_ids=IDS)


def test_dense_matchers_bring_their_keypoints(tmp_path):
    tables = read_points(write_hdf5(tmp_path / "matches.h5", DENSE), image_ids=IDS)
    np.testing.assert_array_equal(tables.image.xy, [[1.0, 2.0], [3.0, 4.5], [5.0, 6.0], [7.0, 8.5]])


def test_damaged_hdf5_is_refused(tmp_path):
    whole = Path(write_hdf5(tmp_path / "whole.h5", DENSE)).read_bytes()
    damaged = tmp_path / "damaged.h5"
    for content in (whole[:200], whole[:8] + bytes(len(whole) - 8)):
        damaged.write_bytes(content)
        with pytest.raises(InputError, match=r"damaged\.h5"):
            read_points(str(damaged), image_ids=IDS)

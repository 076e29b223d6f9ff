"""Exact pushbroom cameras: files written here from the formats' documentation, rays followed by other code."""

import json
from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
import pyproj
import pytest
from rpc_samples import sample_rpc, write_image
from scipy.spatial.transform import Rotation

from hrsi.hrsi_engine.foundation.errors import InputError
from hrsi.hrsi_engine.io.exact_cameras import read_adjusted_camera, read_exact_camera
from hrsi.hrsi_engine.io.rpc_files import read_rpc
from hrsi.processing_algorithms import run
from hrsi.tests.conftest import TEST_DATA

START = datetime(2021, 2, 1, 0, 51, 30)
RADIUS, RATE = 7.078e6, 1.06e-3  # m and rad/s of the orbit
LIGHT = 299_792_458.0
TO_GROUND = pyproj.Transformer.from_crs(4978, 4979, always_xy=True)
SIZE = (1200, 1000)
LINE_S, PIXEL_RAD = 1e-4, 7e-7
PLACES = np.array([[0.0, 0.0], [1199.0, 0.0], [600.25, 499.5], [0.0, 999.0], [1199.0, 999.0]])


def position(t: float) -> np.ndarray:
    angle, node = 0.6 + RATE * t, 0.3 - 7.3e-5 * t  # the node turns with the Earth
    flat = np.array([np.cos(angle), 0.13 * np.sin(angle), np.sqrt(1 - 0.13**2) * np.sin(angle)])
    return RADIUS * Rotation.from_euler("z", node).apply(flat)


def velocity(t: float) -> np.ndarray:
    return (position(t + 0.01) - position(t - 0.01)) / 0.02


def frame(t: float) -> np.ndarray:
    """Columns: along the flight, to its right, and down."""
    down = -position(t) / np.linalg.norm(position(t))
    right = np.cross(down, velocity(t))
    right /= np.linalg.norm(right)
    return np.column_stack([np.cross(right, down), right, down])


def attitude(t: float) -> Rotation:
    """The camera is rolled by 20 and pitched by 8 degrees, and sways a little."""
    return Rotation.from_matrix(frame(t)) * Rotation.from_euler("xy", [0.35 + 2e-6 * np.sin(9 * t), 0.14 + 1e-4 * t])


def height(xyz: np.ndarray) -> float:
    return TO_GROUND.transform(*xyz)[2]


def reach(start: np.ndarray, ray: np.ndarray, level: float) -> np.ndarray:
    """Return where a ray from above comes down to a height, by bisection."""
    near, far = 0.0, 2e6
    lowest = min(np.linspace(near, far, 4001), key=lambda k: height(start + k * ray))
    far = lowest
    for _ in range(70):
        middle = (near + far) / 2
        near, far = (middle, far) if height(start + middle * ray) > level else (near, middle)
    return start + far * ray


def bend(start: np.ndarray, ray: np.ndarray, level: float) -> np.ndarray:
    """Follow a ray through air whose refractivity falls exponentially: d/ds (n dr/ds) = grad n, in steps of 100 m."""
    place = reach(start, ray, 60_000.0)
    while (above := height(place)) > level:
        lon, lat, _ = np.radians(TO_GROUND.transform(*place))
        up = np.array([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)])
        refractivity = 2.77e-4 * np.exp(-above / 8000.0)
        step = min(100.0, (above - level) / -(ray @ up) + 1e-4)
        gradient = -refractivity / 8000.0 * up
        ray = ray + step * (gradient - (gradient @ ray) * ray)
        ray /= np.linalg.norm(ray)
        place = place + step * ray
    return place


def to_xyz(ground: np.ndarray) -> np.ndarray:
    return np.array(pyproj.Transformer.from_crs(4979, 4978, always_xy=True).transform(*ground.T)).T


def words(*numbers: float) -> str:
    return " ".join(repr(float(number)) for number in numbers)


def iso(t: float) -> str:
    return (START + timedelta(seconds=t)).isoformat(timespec="microseconds")


@pytest.fixture
def isd(tmp_path: Path) -> Path:
    """Ephemeris every 20 ms; detectors against y from 5 mm, of 8 micrometres behind 11.43 m."""
    times = np.arange(-1.0, 1.5, 0.02)
    eph = "".join(
        f"<EPHEMLIST>{k + 1} {words(*position(t), *velocity(t))} 0 0 0 0 0 0</EPHEMLIST>"
        for k, t in enumerate(times.tolist())
    )
    att = "".join(
        f"<ATTLIST>{k + 1} {words(*attitude(t).as_quat())} 0 0 0 0 0 0 0 0 0 0</ATTLIST>"
        for k, t in enumerate(times.tolist())
    )
    text = f"""<?xml version="1.0"?><isd><IMD><PRODUCTLEVEL>LV1B</PRODUCTLEVEL><NUMROWS>{SIZE[1]}</NUMROWS>
<NUMCOLUMNS>{SIZE[0]}</NUMCOLUMNS><IMAGE><SATID>WV01</SATID><TLCTIME>{iso(0.0)}Z</TLCTIME><TLCLISTList>
<TLCLIST>0 0</TLCLIST><TLCLIST>{SIZE[1]} {SIZE[1] * LINE_S!r}</TLCLIST></TLCLISTList></IMAGE></IMD>
<EPH><STARTTIME>{iso(times[0])}Z</STARTTIME><TIMEINTERVAL>0.02</TIMEINTERVAL><EPHEMLISTList>{eph}</EPHEMLISTList></EPH>
<ATT><STARTTIME>{iso(times[0])}Z</STARTTIME><TIMEINTERVAL>0.02</TIMEINTERVAL><ATTLISTList>{att}</ATTLISTList></ATT>
<GEO><PD>11430.0</PD><POLYORDER>-1</POLYORDER><QCS1>0</QCS1><QCS2>0</QCS2><QCS3>0</QCS3><QCS4>1</QCS4><BAND_P>
<DETORIGINX>0.3</DETORIGINX><DETORIGINY>5.0</DETORIGINY><DETROTANGLE>0</DETROTANGLE><DETPITCH>0.008</DETPITCH>
</BAND_P></GEO>
</isd>"""
    path = tmp_path / "isd.xml"
    path.write_text(text)
    return path


def test_isd_rays_with_aberration_and_refraction(isd):
    """Against a ray that is traced through the atmosphere, to a tenth of a pixel of 0.5 m."""
    camera = read_exact_camera(str(isd))
    assert camera.size == SIZE
    found = to_xyz(camera.localize(PLACES, 250.0))
    for (x, y), place in zip(PLACES.tolist(), found, strict=True):
        t = y * LINE_S
        seen = attitude(t).apply([0.3, 5.0 - 0.008 * x, 11430.0])
        seen /= np.linalg.norm(seen)
        ray = seen * LIGHT - velocity(t)  # what moves sees light come more from ahead
        expected = bend(position(t), ray / np.linalg.norm(ray), 250.0)
        assert np.linalg.norm(place - expected) < 0.05


def write_spot(path: Path) -> None:
    """As the SPOT Geometry Handbook has it: ephemeris every 30 s, attitudes every 125 ms, look angles of detectors."""
    points = "".join(
        f"<Point><Location><X>{p[0]!r}</X><Y>{p[1]!r}</Y><Z>{p[2]!r}</Z></Location>"
        f"<Velocity><X>{v[0]!r}</X><Y>{v[1]!r}</Y><Z>{v[2]!r}</Z></Velocity><TIME>{iso(t)}</TIME></Point>"
        for t in np.arange(-120.0, 121.0, 30.0).tolist()
        for p, v in [(position(t).tolist(), velocity(t).tolist())]
    )
    turns = "".join(
        f"<Angles><TIME>{iso(t)}</TIME><YAW>{spot_angles(t)[0]!r}</YAW><PITCH>{spot_angles(t)[1]!r}</PITCH>"
        f"<ROLL>{spot_angles(t)[2]!r}</ROLL></Angles>"
        for t in np.arange(-1.0, 1.6, 0.125).tolist()
    )
    looks = "".join(
        f"<Look_Angles><DETECTOR_ID>{k + 1}</DETECTOR_ID><PSI_X>{spot_look(k)[0]!r}</PSI_X>"
        f"<PSI_Y>{spot_look(k)[1]!r}</PSI_Y></Look_Angles>"
        for k in range(SIZE[0])
    )
    path.write_text(f"""<?xml version="1.0"?><Dimap_Document>
<Raster_Dimensions><NCOLS>{SIZE[0]}</NCOLS><NROWS>{SIZE[1]}</NROWS>
</Raster_Dimensions><Data_Strip><Ephemeris>
<Points>{points}</Points></Ephemeris><Satellite_Attitudes><Corrected_Attitudes>
<Corrected_Attitude>{turns}</Corrected_Attitude>
</Corrected_Attitudes></Satellite_Attitudes><Sensor_Configuration><Time_Stamp>
<LINE_PERIOD>{LINE_S!r}</LINE_PERIOD>
<SCENE_CENTER_TIME>{iso(0.05)}</SCENE_CENTER_TIME><SCENE_CENTER_LINE>500</SCENE_CENTER_LINE></Time_Stamp>
<Instrument_Look_Angles_List><Instrument_Look_Angles><Look_Angles_List>{looks}</Look_Angles_List>
</Instrument_Look_Angles></Instrument_Look_Angles_List></Sensor_Configuration></Data_Strip></Dimap_Document>""")


def spot_angles(t: float) -> tuple[float, float, float]:
    return 3e-3 + 1e-4 * t, -2e-3 + 2e-4 * t, 1e-3 - 1e-4 * t


def spot_look(detector: int) -> tuple[float, float]:
    return 0.35 + 1e-9 * detector, 0.02 - PIXEL_RAD * detector


def spot_ground(x: float, y: float, level: float) -> np.ndarray:
    t = 0.05 + LINE_S * (y + 1 - 500)
    psi_x, psi_y = spot_look(x)
    look = np.array([-np.tan(psi_y), np.tan(psi_x), -1.0])
    yaw, pitch, roll = spot_angles(t)
    cp, sp, cr, sr, cy, sy = (f(a) for a in (pitch, roll, yaw) for f in (np.cos, np.sin))
    navigation = np.array([[1, 0, 0], [0, cp, sp], [0, -sp, cp]]) @ np.array([[cr, 0, -sr], [0, 1, 0], [sr, 0, cr]])
    navigation = navigation @ np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])
    z = position(t) / np.linalg.norm(position(t))
    across = np.cross(velocity(t), z)
    across /= np.linalg.norm(across)
    ray = np.column_stack([across, np.cross(z, across), z]) @ navigation @ look
    return reach(position(t), ray / np.linalg.norm(ray), level)


def test_spot5_rays(tmp_path):
    write_spot(tmp_path / "METADATA.DIM")
    camera = read_exact_camera(str(tmp_path / "METADATA.DIM"))
    found = to_xyz(camera.localize(PLACES, 800.0))
    expected = [spot_ground(x, y, 800.0) for x, y in PLACES.tolist()]
    np.testing.assert_allclose(found, expected, atol=0.02)  # m, of a pixel of 5 m


def write_csm(path: Path, **changes: object) -> None:
    """A state of the USGS line scanner whose look vectors point away from the ground, as those of ASP do."""
    times = np.arange(-1.0, 1.5, 0.02).tolist()
    turned = [(attitude(t) * Rotation.from_euler("x", 180, degrees=True)).as_quat().tolist() for t in times]
    state = {
        "m_modelName": "USGS_ASTRO_LINE_SCANNER_SENSOR_MODEL", "m_nLines": SIZE[1], "m_nSamples": SIZE[0],
        "m_positions": [v for t in times for v in position(t).tolist()],
        "m_velocities": [v for t in times for v in velocity(t).tolist()],
        "m_quaternions": [v for q in turned for v in q],
        "m_t0Ephem": -1.0, "m_dtEphem": 0.02, "m_t0Quat": -1.0, "m_dtQuat": 0.02, "m_intTimeLines": [1.0],
        "m_intTimeStartTimes": [0.0], "m_intTimes": [LINE_S], "m_detectorSampleOrigin": 0.0,
        "m_detectorLineOrigin": 0.0,
        "m_detectorSampleSumming": 1.0, "m_detectorLineSumming": 1.0, "m_startingDetectorSample": -600.0,
        "m_startingDetectorLine": 0.0, "m_iTransS": [0.0, 1.0, 0.0], "m_iTransL": [0.0, 0.0, 1.0], "m_zDirection": 1.0,
        "m_focalLength": 1.4e6, "m_currentParameterValue": [0.0] * 16, "m_opticalDistCoeffs": [0.0] * 3, **changes,
    }  # fmt: skip
    path.write_text(f"{state['m_modelName']}\n{json.dumps(state)}")


def csm_ground(x: float, y: float, level: float) -> np.ndarray:
    """After ``losToEcf``: pixels from the corner, time at the middle of the exposure."""
    sample, line = x + 0.5, y + 0.5
    t = 0.0 + LINE_S * (line - 1.0 + 0.5)
    look = np.array([-(sample - 600.0), 0.0, -1.4e6])
    ray = (attitude(t) * Rotation.from_euler("x", 180, degrees=True)).apply(look)
    ray /= np.linalg.norm(ray)
    ray *= -np.sign(ray @ position(t))
    return reach(position(t), ray, level)


def test_csm_rays(tmp_path):
    write_csm(tmp_path / "run.adjusted_state.json")
    camera = read_exact_camera(str(tmp_path / "run.adjusted_state.json"))
    found = to_xyz(camera.localize(PLACES, 100.0))
    np.testing.assert_allclose(found, [csm_ground(x, y, 100.0) for x, y in PLACES.tolist()], atol=1e-3)


@pytest.mark.parametrize("model", ["USGS_ASTRO_FRAME_SENSOR_MODEL", "USGS_ASTRO_SAR_SENSOR_MODEL"])
def test_other_csm_states_get_an_answer(tmp_path, model):
    write_csm(tmp_path / "state.json", m_modelName=model)
    with pytest.raises(InputError, match=f"{model}: only that of USGS_ASTRO_LINE_SCANNER"):
        read_exact_camera(str(tmp_path / "state.json"))
    write_csm(tmp_path / "bent.json", m_opticalDistCoeffs=[0.0, 1e-3, 0.0])
    with pytest.raises(InputError, match="lens distortion"):
        read_exact_camera(str(tmp_path / "bent.json"))


def test_an_adjustment_moves_the_exact_camera(tmp_path, isd):
    """VisionWorkbench's formula about the position at pixel (0, 0): moved back, its points lie on the given rays."""
    turn = Rotation.from_rotvec([1e-5, -2e-5, 1.5e-5])
    move = np.array([1.25, -2.5, 0.75])
    adjust = tmp_path / "run-isd.adjust"
    adjust.write_text(f"{words(*move)}\n{words(*np.roll(turn.as_quat(), 1))}\n")
    isd.write_text(isd.read_text().replace("LV1B", "Stereo 1B"))
    given, adjusted = read_exact_camera(str(isd)), read_adjusted_camera(f"{adjust}|camera={isd}")
    assert adjusted.size == given.size == SIZE
    low, high = (to_xyz(given.localize(PLACES, level)) for level in (0.0, 1000.0))
    ray = (high - low) / np.linalg.norm(high - low, axis=1)[:, None]
    centre = position(0.0)
    for level in (100.0, 900.0):
        place = to_xyz(adjusted.localize(PLACES, level))
        back = (place - centre - move) @ turn.as_matrix() + centre
        np.testing.assert_allclose(np.cross(back - low, ray), 0.0, atol=0.02)  # refraction is not straight
        assert np.linalg.norm(place - to_xyz(given.localize(PLACES, level)), axis=1).min() > 1.0
    write_image(tmp_path / "isd.tif", sample_rpc())
    with pytest.raises(InputError, match=r"isd\.tif: next to it is the exact camera .*add .session=rpc"):
        read_adjusted_camera(f"{adjust}|camera={tmp_path / 'isd.tif'}")


def test_damaged_and_other_files(tmp_path, isd):
    text = isd.read_text()
    (tmp_path / "ortho.xml").write_text(text.replace("LV1B", "LV2A"))
    assert read_exact_camera(str(tmp_path / "ortho.xml")) is None
    (tmp_path / "short.xml").write_text(text.replace("<PD>11430.0</PD>", ""))
    with pytest.raises(InputError, match="PD is missing"):
        read_exact_camera(str(tmp_path / "short.xml"))
    for number, hostile in enumerate((
        '{"m_quaternions": ' + "[" * 100_000, '{"m_quaternions": [1e999]}', "<a><!-- <Corrected_Attitudes --></a>",
        text.replace("<TIMEINTERVAL>0.02", "<TIMEINTERVAL>nan"), text[: len(text) // 2],
    )):  # fmt: skip
        (tmp_path / f"hostile{number}.xml").write_text(hostile)
        with pytest.raises(InputError, match=f"hostile{number}.xml"):
            read_exact_camera(str(tmp_path / f"hostile{number}.xml"))
    (tmp_path / "points.csv").write_text("id,lon,lat\n1,2,3\n")
    assert read_exact_camera(str(tmp_path / "points.csv")) is None


@pytest.mark.parametrize("kind", ["isd", "spot", "csm"])
def test_rpc_of_an_exact_camera(tmp_path, isd, kind):
    """The fitted RPC sees where rays reach other heights at their pixels, to 0.02 px, and rpc-info tells it."""
    path = {"isd": isd, "spot": tmp_path / "METADATA.DIM", "csm": tmp_path / "state.json"}[kind]
    if kind == "spot":
        write_spot(path)
    elif kind == "csm":
        write_csm(path)
    with pytest.raises(InputError, match="min_height"):
        run("fit-rpc", points=str(path), output_dir=str(tmp_path / "none"))
    report = run(
        "fit-rpc", points=str(path), id="fit", min_height=0.0, max_height=900.0, output_dir=str(tmp_path / "out")
    )
    assert report["check"]["max_px"] < 0.02 and report["warnings"] == []
    rpc = read_rpc(str(tmp_path / "out" / "fit_RPC.TXT")).rpc
    camera = read_exact_camera(str(path))
    xy = np.random.default_rng(4).uniform(0, 999, (50, 2))
    np.testing.assert_allclose(rpc.project(camera.localize(xy, 333.0)), xy, atol=0.02)


def test_worldview_rpcs_against_their_own_cameras():
    """Maxar's ephemeris, attitude and detectors give Maxar's RPCs, on both parts of a strip, to 0.25 px."""
    paths = sorted((TEST_DATA / "real" / "wv1_tiles").glob("WV01*.xml"))
    if not paths:
        pytest.skip("real data are not there")
    told = run("rpc-info", images=[str(path) for path in paths])["images"]
    assert [entry["exact_camera"]["max_px"] < 0.25 for entry in told.values()] == [True, True]

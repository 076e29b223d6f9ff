"""Exact pushbroom cameras in the formats of vendors and other programs; each format is recognised by its content.

* ISD XML of WorldView, GeoEye and QuickBird, basic images (LV1, Stereo 1B): EPH and ATT at equal steps of time, with
  x, y, z, w of the quaternion from the camera's body, line times (TLC), principal distance and the position of the
  detectors in mm. With increasing sample the detectors follow the camera's -y axis; the flight is along x. (ISD
  documentation, Maxar.)
* DIMAP V1 of SPOT 5: Ephemeris, Corrected_Attitudes, a look angle of each detector. Positions are interpolated over
  eight points, attitudes linearly; lines and detectors are counted from 1. (SPOT 123-4-5 Geometry Handbook,
  GAEL-P135-DOC-001, equations 5 to 11.)
* CSM states of the USGS line scanner, also those that ASP has adjusted: JSON after the model's name. Pixel coordinates
refer to the corner of the first pixel. (DOI-USGS/usgscsm, ``UsgsAstroLsSensorModel``.)
* ``.adjust`` of ASP for the camera that the user names after it, ``FILE|camera=CAMERA``: an ISD XML with ephemeris
(session dg), or an image or file with an RPC (session rpc). Text: the translation (m), the quaternion with its scalar
first, and, for cropped or scaled images, offset and scale of the pixels. A physical camera is rotated about its
position at pixel (0, 0). (StereoPipeline, ``asp::read_adjustments``; VisionWorkbench, ``AdjustedCameraModel``.)
"""

from __future__ import annotations

import json
import os
import re
from collections.abc import Callable
from dataclasses import replace
from datetime import UTC, datetime
from typing import Any

import numpy as np

from ..camera.linescan import AdjustedRpc, LinescanCamera
from ..foundation.errors import InputError
from .opening.datasets import read_head
from .opening.files import Element, read_bytes, read_xml
from .rpc_files.content import element_text, siblings
from .rpc_files.find import read_rpc_or_none, side_files

_CSM_LINE_SCANNER = "USGS_ASTRO_LINE_SCANNER_SENSOR_MODEL"
_HANDBOOK_POINTS = 8
_SESSION = re.compile(rb"bundle_adjust.*\s(?:-t|--session-type)[ =]+(\w+)")
_UNIT = 1e-3  # largest deviation of a quaternion's norm from 1: some files have only six digits


def read_exact_camera(path: str) -> LinescanCamera | None:
    """Return the exact camera in a file, None if it contains none; raise `InputError` if it is damaged."""
    try:
        head = read_head(path)
    except InputError:
        return None
    reader = next((read for mark, read in _READERS if mark in head), None)
    if reader is None:
        return None
    try:
        return reader(path)
    except (TypeError, ValueError, LookupError, AttributeError, StopIteration, RecursionError, OverflowError) as error:
        raise InputError(f"{path}: its ephemeris, attitude or detectors are damaged ({error}): get it again") from None


def read_adjusted_camera(spec: str) -> AdjustedRpc | LinescanCamera | None:
    """Return the camera that ASP's adjustment moves (``FILE|camera=CAMERA``); None for a file that is no ``.adjust``.

    An image with RPC may have been adjusted with its RPC or with an exact camera: ``|session=NAME`` after the image
    states it, otherwise the log of the run.
    """
    path, _, camera = spec.partition("|camera=")
    camera, _, stated = camera.partition("|session=")
    session = stated or _find_session(path)
    if not camera and not path.lower().endswith(".adjust"):
        return None
    try:
        numbers = np.array([float(word) for word in read_bytes(path).split()])
    except ValueError:
        numbers = np.empty(0)
    known = len(numbers) in (7, 10) and np.isfinite(numbers).all()
    if not known or abs(np.linalg.norm(numbers[3:7]) - 1.0) > _UNIT:
        raise InputError(f"{path}: is no translation and unit quaternion of one camera: obtain it again")
    if not camera:
        raise InputError(f"{path}: moves a camera that it does not contain: name it, {path}|camera=IMAGE")
    from scipy.spatial.transform import Rotation

    turn = Rotation.from_quat(np.roll(numbers[3:7], -1)).as_matrix()
    offset, scale = (numbers[7:9], float(numbers[9])) if len(numbers) > 7 else (np.zeros(2), 1.0)
    exact, is_state = read_exact_camera(camera), camera.lower().endswith(".json")
    beside = None if exact is not None or session == "rpc" or is_state else find_exact_camera(camera, None)
    if beside is not None and not session:
        raise InputError(
            f"{camera}: next to it is the exact camera ({beside.source}), which {path} moves unless bundle_adjust ran "
            "with -t rpc: name the XML file as the camera, or add |session=rpc after the image"
        )
    linescan = exact or beside
    if linescan is not None and session != "rpc" and not is_state:
        return _adjust_linescan(linescan, turn, numbers[:3], offset, scale)
    if session not in ("", "rpc") and not is_state:
        raise InputError(
            f"{camera}: {path} is of a session -t {session}, which moves the exact camera, and this is an RPC: name "
            "the camera file (the ISD XML with ephemeris, or the adjusted_state.json that bundle_adjust writes), or "
            "add |session=rpc after the image if its RPC was adjusted"
        )
    found = None if exact is not None and is_state else read_rpc_or_none(camera)
    if found is None:
        raise InputError(
            f"{camera}: {f'is a {exact.source}' if exact else 'has no RPC'}, and {path} can only be applied to an RPC: "
            "name the adjusted_state.json that bundle_adjust writes for CSM cameras"
        )
    rpc = found.rpc
    size = found.size or (round(rpc.samp_off + abs(rpc.samp_scale)) + 1, round(rpc.line_off + abs(rpc.line_scale)) + 1)
    low, high = sorted([rpc.height_off - rpc.height_scale, rpc.height_off + rpc.height_scale])
    notice = (
        f"{path}: is applied to the RPC of {camera}, which is right if bundle_adjust ran with -t rpc: after -t dg name "
        "the XML file with ephemeris as the camera"
    )
    return AdjustedRpc(
        rpc,
        size,
        turn,
        translation=numbers[:3],
        offset=offset,
        scale=scale,
        heights_m=(low, high),
        notice="" if session else notice,
    )


def _find_session(path: str) -> str:
    """Return the session that the command in the last log of a run of bundle_adjust names, "" if none does."""
    name, files = os.path.basename(path).lower(), siblings(path)
    logs = [file for file in files if "-log-" in file and name.startswith(file.partition("-log-")[0])]
    for log in sorted(logs, reverse=True):
        if found := _SESSION.search(read_head(files[log])):
            return found[1].decode().lower()
    return ""


def _adjust_linescan(
    camera: LinescanCamera, rotation: np.ndarray, translation: np.ndarray, offset: np.ndarray, scale: float
) -> LinescanCamera:
    """Return a camera rotated about its position at pixel (0, 0) and then translated, for the pixels of a crop."""
    lines, times = camera.line_times.T
    centre = camera.position(np.array([np.interp(0.0, lines, times)]))[0]
    size = np.round((np.array(camera.size) - offset) / scale).astype(int).tolist()
    return replace(
        camera,
        size=(size[0], size[1]),
        line_times=np.column_stack([(lines - offset[1]) / scale, times]),
        position=lambda time: (camera.position(time) - centre) @ rotation.T + centre + translation,
        velocity=lambda time: camera.velocity(time) @ rotation.T,
        attitude=lambda time: rotation @ camera.attitude(time),
        look=lambda sample: camera.look(scale * sample + offset[0]),
    )


def find_exact_camera(path: str, size: tuple[int, int] | None) -> LinescanCamera | None:
    """Return the exact camera of an uncropped image, from its own XML file or one next to it; None if there is none."""
    files = [path, *(file for side_list in side_files(path).values() for file in side_list)]
    cameras = (read_exact_camera(file) for file in files if file.lower().endswith(".xml"))
    return next((camera for camera in cameras if camera is not None and size in (None, camera.size)), None)


def _require(root: Element, name: str) -> str:
    text = element_text(root, name)
    if text is None:
        raise ValueError(f"{name} is missing")
    return text


def _seconds(text: str) -> float:
    return datetime.fromisoformat(text.strip().replace("Z", "+00:00")).replace(tzinfo=UTC).timestamp()


def _numbers(root: Element, name: str) -> np.ndarray:
    return np.array([[float(word) for word in (element.text or "").split()] for element in root.iter(name)])


def _turn(times: np.ndarray, quaternions: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
    """Return a function from times (m,) to rotations (m, 3, 3): splines of quaternions (n, 4) with the scalar last."""
    from scipy.interpolate import CubicSpline
    from scipy.spatial.transform import Rotation

    signs = np.cumprod(np.sign(np.r_[1.0, (quaternions[1:] * quaternions[:-1]).sum(axis=1)]))  # -q is q: equal signs
    between = CubicSpline(times, quaternions * signs[:, None])
    return lambda time: Rotation.from_quat(between(time)).as_matrix()


def _read_isd(path: str) -> LinescanCamera | None:
    from scipy.interpolate import CubicSpline
    from scipy.spatial.transform import Rotation

    root = read_xml(path)
    eph, att, geo, image = (next(root.iter(name), None) for name in ("EPH", "ATT", "GEO", "IMAGE"))
    level = (element_text(root, "PRODUCTLEVEL") or "").strip()
    is_basic = level.startswith("LV1") or level.endswith("1B")  # LV1B, Stereo 1B
    if eph is None or att is None or geo is None or image is None or not is_basic:
        return None  # an RPC alone, or an image that has been resampled
    if float(element_text(geo, "POLYORDER") or -1) >= 0:
        raise InputError(f"{path}: has optical distortion, which is not read: use its RPC")
    positions, quaternions = _numbers(eph, "EPHEMLIST"), _numbers(att, "ATTLIST")
    times, turns = (
        _seconds(_require(part, "STARTTIME")) + float(_require(part, "TIMEINTERVAL")) * np.arange(len(rows))
        for part, rows in ((eph, positions), (att, quaternions))
    )
    lines = _numbers(image, "TLCLIST")
    lines[:, 1] += _seconds(_require(image, "TLCTIME"))
    x, y, pitch, distance, angle = (
        float(_require(geo, name)) for name in ("DETORIGINX", "DETORIGINY", "DETPITCH", "PD", "DETROTANGLE")
    )
    mounting = Rotation.from_quat([float(_require(geo, f"QCS{number}")) for number in (1, 2, 3, 4)])
    along = np.array([np.sin(np.radians(angle)), -np.cos(np.radians(angle)), 0.0]) * pitch
    rpc = next(root.iter("RPB"), None)
    middle, half = (0.0 if rpc is None else float(_require(rpc, name)) for name in ("HEIGHTOFFSET", "HEIGHTSCALE"))
    return LinescanCamera(
        "ISD ephemeris and attitude",
        (int(_require(root, "NUMCOLUMNS")), int(_require(root, "NUMROWS"))),
        lines,
        position=CubicSpline(times, positions[:, 1:4]),
        velocity=CubicSpline(times, positions[:, 4:7]),
        attitude=_turn(turns, quaternions[:, 1:5]),
        look=lambda sample: mounting.apply(np.array([x, y, distance]) + sample[:, None] * along),
        through_air=True,
        heights_m=None if rpc is None else (middle - half, middle + half),
    )


def _read_dimap(path: str) -> LinescanCamera | None:
    root = read_xml(path)
    from scipy.interpolate import BarycentricInterpolator
    from scipy.spatial.transform import Rotation

    points, angles = [*root.iter("Point")], [*next(root.iter("Corrected_Attitudes")).iter("Angles")]
    times = np.array([_seconds(_require(point, "TIME")) for point in points])
    positions, velocities = (
        np.array([[float(_require(next(point.iter(part)), axis)) for axis in "XYZ"] for point in points])
        for part in ("Location", "Velocity")
    )
    period, middle = float(_require(root, "LINE_PERIOD")), _seconds(_require(root, "SCENE_CENTER_TIME"))
    first = middle + period * (1.0 - float(_require(root, "SCENE_CENTER_LINE")))
    size = int(_require(root, "NCOLS")), int(_require(root, "NROWS"))
    nearest = np.sort(np.argsort(np.abs(times - middle))[:_HANDBOOK_POINTS])
    position, velocity = (
        BarycentricInterpolator(times[nearest] - middle, rows[nearest]) for rows in (positions, velocities)
    )
    turn_times = np.array([_seconds(_require(one, "TIME")) for one in angles])
    turns = np.array([[float(_require(one, name)) for name in ("YAW", "PITCH", "ROLL")] for one in angles])
    psi = np.array([[float(_require(one, name)) for name in ("PSI_X", "PSI_Y")] for one in root.iter("Look_Angles")])
    tangents, detectors = np.tan(psi), np.arange(len(psi), dtype=np.float64)

    def attitude(time: np.ndarray) -> np.ndarray:
        yaw, pitch, roll = (np.interp(time, turn_times, column) for column in turns.T)
        place = position(time - middle)
        z = place / np.linalg.norm(place, axis=1)[:, None]
        x = np.cross(velocity(time - middle), z)
        x /= np.linalg.norm(x, axis=1)[:, None]
        # pitch about x and roll about y are left-handed, yaw is right-handed
        turn = Rotation.from_euler("XYZ", np.column_stack([-pitch, -roll, yaw])).as_matrix()
        return np.asarray(np.stack([x, np.cross(z, x), z], axis=2) @ turn)

    def look(sample: np.ndarray) -> np.ndarray:
        tan_x, tan_y = (np.interp(sample, detectors, column) for column in tangents.T)
        return np.column_stack([-tan_y, tan_x, -np.ones(len(sample))])

    return LinescanCamera(
        "DIMAP V1 ephemeris and attitudes",
        size,
        np.array([[0.0, first], [size[1], first + period * size[1]]]),  # far apart: seconds since 1970 resolve 2e-7 s
        position=lambda time: np.asarray(position(time - middle)),
        velocity=lambda time: np.asarray(velocity(time - middle)),
        attitude=attitude,
        look=look,
        through_air=False,
    )


def _read_csm(path: str) -> LinescanCamera | None:
    from scipy.interpolate import CubicSpline

    name, _, body = read_bytes(path).decode("utf-8").partition("{")
    state: dict[str, Any] = json.loads("{" + body)
    model = name.strip() or str(state.get("m_modelName"))
    if model != _CSM_LINE_SCANNER:
        raise InputError(f"{path}: is a CSM state of {model[:60]}: only that of {_CSM_LINE_SCANNER} is read")
    if np.any(state["m_currentParameterValue"]) or np.any(state["m_opticalDistCoeffs"]):
        raise InputError(
            f"{path}: has corrections or lens distortion in addition to its poses, which are not read: "
            "write them into positions and quaternions (ASP: bundle_adjust, jitter_solve)"
        )
    positions, velocities = (np.reshape(state[key], (-1, 3)) for key in ("m_positions", "m_velocities"))
    quaternions = np.reshape(state["m_quaternions"], (-1, 4))
    times = state["m_t0Ephem"] + state["m_dtEphem"] * np.arange(len(positions))
    turns = state["m_t0Quat"] + state["m_dtQuat"] * np.arange(len(quaternions))
    lines = np.column_stack([np.array(state["m_intTimeLines"]) - 1.0, state["m_intTimeStartTimes"]])
    lines = np.vstack([lines, lines[-1] + [1.0, state["m_intTimes"][-1]]])
    to_detector = np.array([state["m_iTransS"], state["m_iTransL"]])
    origin = np.array([state["m_detectorSampleOrigin"], state["m_detectorLineOrigin"]]) + to_detector[:, 0]
    focal = np.array([state["m_zDirection"], state["m_zDirection"], state["m_focalLength"]])

    def look(sample: np.ndarray) -> np.ndarray:
        detector = np.column_stack(
            [
                (sample + 0.5) * state["m_detectorSampleSumming"] + state["m_startingDetectorSample"],
                np.full(len(sample), state["m_startingDetectorLine"]),
            ]
        )
        plane = np.linalg.solve(to_detector[:, 1:], (detector - origin).T).T
        return -np.column_stack([plane, np.ones(len(sample))]) * focal

    return LinescanCamera(
        "CSM state",
        (state["m_nSamples"], state["m_nLines"]),
        lines,
        position=CubicSpline(times, positions),
        velocity=CubicSpline(times, velocities),
        attitude=_turn(turns, quaternions),
        look=look,
        through_air=False,
    )


_READERS: tuple[tuple[bytes, Callable[[str], LinescanCamera | None]], ...] = (
    (b"<EPHEMLIST", _read_isd),
    (b"<Corrected_Attitudes", _read_dimap),
    (b'"m_quaternions"', _read_csm),
    (b"USGS_ASTRO_", _read_csm),
)

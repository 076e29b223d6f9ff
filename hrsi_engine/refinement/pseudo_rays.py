"""Pseudo light rays of image points for the generic method (thesis section 4.3, step 1; eqs. 4.10-4.11).

The ray of an image point passes through its ground positions at the two ends of the RPC's height range, in a
topocentric frame about the middle of the image. X is along the samples and Y to its left (against the lines), so that
psi_x is roll and psi_y is pitch; z is up. The pseudo sensor is the point of the ray at the height H at which the rays
of its line intersect::

    X(z) = Xs + (H - z) tan(psi_x)        Y(z) = Ys + (H - z) tan(psi_y)

The thesis fixes H ("e.g. 600 km"); any value suits small corrections. Corrections of 0.1 rad must rotate the rays at
their true intersection: 100 m of its height, as an orbit curves over an image, are 10 m on the ground.

The rays of an RPC are not exactly straight; the deviation at the middle of the height range (*sag*, usually far below a
millimetre) is kept as a parabola, so that a pseudo sensor without corrections reproduces the RPC.

Intersection of a corrected pseudo ray with a height, and its observation equations (generic method).

Each formula is written once, for one image point in compiled loops and for all points of an image with NumPy;
`pseudo_sensor` has the derivation. With (u, v) the image position centred and scaled to [-1, 1], each of the seven
corrections is ``a0 + aS u + aL v``. The direction ``(tan psi_x, tan psi_y, -1)`` of the ray is rotated by pitch, roll
and yaw at the station and extended to the height z; the point there is rotated by psi_z about the middle of the image.
The derivatives follow by the chain rule.

The observation equation in metres, ``(x, y)(image point, values, z) = ground``, is solved for the image point by two
Newton steps: the first from the observed point, the second from its result, with the derivatives there. One step is
enough for small residuals; with large ones its derivatives by the values omit the change of the step, and the
adjustment would not converge to its minimum.
"""

from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Any

import numpy as np

from ..block.block import Image
from ..block.imaging_geometry import GEOMETRY
from ..camera.perspective import PERSPECTIVE
from ..camera.rpc import RPC
from ..foundation.errors import SolveError
from ..foundation.large_arrays import invert_2x2
from ..foundation.thresholds import EQUALITY, threshold, thresholds
from ..ground.ellipsoid import Couple, Number, Triple
from ..ground.geodesy import LocalFrame, east_north_up
from .model import RowIndex


@thresholds
class SENSOR:
    """Limits for plausible pseudo sensors, and for the convergence of their rays."""

    usual_height_m: float = threshold(600e3, "m", "height of the sensor, if not computed", "thesis, section 4.3")


@dataclass(frozen=True)
class SensorFrame:
    """The frame of an image's pseudo sensor: `LocalFrame` rotated about its up axis by ``azimuth_rad``.

    ``heights_m`` are z of the pseudo sensor at the first, middle and last line; ``centre_px`` and ``half_size_px``
    those of the image.
    """

    local: LocalFrame
    azimuth_rad: float
    centre_px: np.ndarray
    half_size_px: np.ndarray
    heights_m: tuple[float, float, float] = (SENSOR.usual_height_m,) * 3

    @cached_property
    def constants(self) -> np.ndarray:
        """Constants for the formulas ``(19,)``: axes (9), origin (3), centre (2), half size (2), heights (3)."""
        return np.concatenate([self.axes.ravel(), self.local.origin, self.centre_px, self.half_size_px, self.heights_m])

    @cached_property
    def _turn(self) -> np.ndarray:
        """Rows: the X, Y and z axes in east, north, up."""
        cos, sin = np.cos(self.azimuth_rad), np.sin(self.azimuth_rad)
        return np.array([[cos, sin, 0.0], [-sin, cos, 0.0], [0.0, 0.0, 1.0]])

    @cached_property
    def axes(self) -> np.ndarray:
        """Rows: the X, Y and z axes in geocentric coordinates."""
        return np.asarray(self._turn @ self.local.axes)

    def from_ground(self, ground: np.ndarray) -> np.ndarray:
        """Return X, Y, z in metres, ``(n, 3)``, of lon, lat, height points."""
        return self.local.from_ground(ground) @ self._turn.T

    def to_ground(self, position: np.ndarray) -> np.ndarray:
        """Return lon, lat, height ``(n, 3)`` of X, Y, z points."""
        return self.local.to_ground(position @ self._turn)


#: Columns of a table of rays ``(n, 18)``. Xs, Ys at the pseudo sensor's height, and tan psi_x, tan psi_y; the
#: derivatives of both by sample and line (those of X first); deviation of the RPC from the straight ray in X and Y at
#: half its height (sag, m); z of the upper end, and the height difference to the lower end; z of the pseudo sensor, and
#: its change from line to line.
STATION, TANGENT, SENSOR_HEIGHT = slice(0, 2), slice(2, 4), 16


@lru_cache(maxsize=1024)
def compute_sensor_frame(image: Image) -> SensorFrame:
    """Return the frame of an image: its origin is below the centre of the image, on the ellipsoid."""
    nadir = image.rpc.localize(image.camera_centre_px[None], image.rpc.height_off).ground[0]
    if not np.isfinite(nadir).all():
        raise SolveError(f"{image.id}: the RPC has no ground position for the middle of the image: check that both fit")
    centre, half_size = image.camera_centre_px, image.camera_half_size_px
    level = SensorFrame(LocalFrame(float(nadir[0]), float(nadir[1])), 0.0, centre, half_size)
    ends = np.array([[u, v] for v in (-1.0, 0.0, 1.0) for u in (-1.0, 1.0)])
    rays = compute_pseudo_rays(image.rpc, level, centre + half_size * ends)
    on_datum = rays[:, STATION] + rays[:, SENSOR_HEIGHT, None] * rays[:, TANGENT]
    east, north = on_datum[3] - on_datum[2]
    # The sensor heights z of the three lines: where the rays of both ends of a line are closest to each other
    difference = rays[1::2, STATION] - rays[::2, STATION]
    opening = rays[1::2, TANGENT] - rays[::2, TANGENT]
    with np.errstate(divide="ignore", invalid="ignore"):
        z = rays[::2, SENSOR_HEIGHT] + np.sum(difference * opening, axis=1) / np.sum(opening**2, axis=1)
    first, middle, last = z.tolist()
    heights = first, middle, last
    if not PERSPECTIVE.distance_m[0] <= middle <= PERSPECTIVE.distance_m[1]:
        heights = (SENSOR.usual_height_m,) * 3
    elif not max(abs(first - middle), abs(last - middle)) <= EQUALITY.alike * middle:
        heights = (middle,) * 3
    return replace(level, azimuth_rad=float(np.arctan2(north, east)), heights_m=heights)


def compute_pseudo_rays(rpc: RPC, frame: SensorFrame, image_px: np.ndarray) -> np.ndarray:
    """Return the rays of image points ``(n, 2)`` as a table ``(n, 18)`` with the columns described above.

    Rows are NaN where the RPC has no ground position for a point.
    """

    def differentiate(ground: np.ndarray) -> np.ndarray:
        """Return the derivatives ``(n, 2, 3)`` of X, Y, z at the height of ground points, by sample and by line."""
        by_ground = rpc.project_with_metric_jacobian(ground)[1]
        by_east, by_north = invert_2x2(by_ground[:, :, :2]).transpose(1, 2, 0)[..., None]
        east_north = east_north_up(ground[:, 0], ground[:, 1])[:, :2].reshape(-1, 3) @ frame.axes.T
        east, north = east_north.reshape(-1, 2, 3).swapaxes(0, 1)
        return np.stack([by_east[0] * east + by_north[0] * north, by_east[1] * east + by_north[1] * north], axis=1)

    reach = max(abs(rpc.height_scale), GEOMETRY.ray_reach_m / 2.0)
    lower, halfway, upper = (rpc.localize(image_px, rpc.height_off + share * reach).ground for share in (-1, 0, 1))
    low, middle, high = (frame.from_ground(ground) for ground in (lower, halfway, upper))
    low_by, high_by = differentiate(lower), differentiate(upper)
    # z of the pseudo sensor: a parabola through those of the first, middle and last line
    (first, central, last), half_lines = frame.heights_m, frame.half_size_px[1]
    v = (image_px[:, 1] - frame.centre_px[1]) / half_lines
    slope, bend = (last - first) / 2.0, (first + last) / 2.0 - central
    height, height_by_line = central + slope * v + bend * v * v, (slope + 2.0 * bend * v) / half_lines
    span, rise = high[:, 2] - low[:, 2], (high[:, 2] - height)[:, None]
    tangent = (low - high)[:, :2] / span[:, None]
    change = low_by - high_by
    tangent_by = (change[:, :, :2] + tangent[:, None] * change[:, :, 2:]) / span[:, None, None]
    station_by = high_by[:, :, :2] + rise[:, None] * tangent_by + tangent[:, None] * high_by[:, :, 2:]
    station_by[:, 1] -= tangent * height_by_line[:, None]
    sag = (middle - high)[:, :2] - (high - middle)[:, 2:] * tangent
    slopes = (by.swapaxes(1, 2).reshape(-1, 4) for by in (station_by, tangent_by))
    return np.column_stack(
        [high[:, :2] + rise * tangent, tangent, *slopes, sag, high[:, 2], span, height, height_by_line]
    )


def rays_of_image(image: Image, image_px: np.ndarray) -> np.ndarray:
    """Return the rays of image points ``(n, 2)`` in the frame of their image, see `compute_pseudo_rays`."""
    return compute_pseudo_rays(image.rpc, compute_sensor_frame(image), image_px)


# ---- formulas shared by compiled loops (one image point) and NumPy (all of an image) ---------------------------------


def _rotate(angle: Number, first: Number, second: Number) -> Couple[Number]:
    """Return ``cos first + sin second`` and ``-sin first + cos second``."""
    cos, sin = np.cos(angle), np.sin(angle)
    return cos * first + sin * second, cos * second - sin * first


def _differentiate_tangents(change: Triple[Number], x: Number, y: Number, down: Number) -> Couple[Number]:
    """Return the change of a direction's tangents x, y for a ``change`` of its vector, whose -z is ``down``."""
    return (change[0] + x * change[2]) / down, (change[1] + y * change[2]) / down


def _rotate_direction(roll: Number, pitch: Number, yaw: Number, x: Number, y: Number, z: Number) -> Triple[Number]:
    """Return a direction rotated by pitch in the plane (z, y), roll in (z, x) and yaw in (x, y), in this order.

    For a direction with z = -1, positive roll and pitch increase its tangents in x and y.
    """
    z, y = _rotate(pitch, z, y)
    z, x = _rotate(roll, z, x)
    x, y = _rotate(yaw, x, y)
    return x, y, z


def _rotate_ray(
    rays: np.ndarray, row: RowIndex, ahead: Couple[Number], roll: Number, pitch: Number, yaw: Number
) -> Any:
    """Return the tangents x, y of a ray's direction, rotated at its station, and their derivatives.

    rays, row, ahead : as in `intersect_frame_height`; roll, pitch, yaw : rad

    Result: x, y; their derivatives by roll, pitch, yaw, and by the sample and line of the ray.
    """
    to_sample, to_line = ahead
    tx = rays[row, 2] + rays[row, 8] * to_sample + rays[row, 9] * to_line
    ty = rays[row, 3] + rays[row, 10] * to_sample + rays[row, 11] * to_line
    pitched_z, pitched_y = _rotate(pitch, -1.0, ty)
    rolled_z, rolled_x = _rotate(roll, pitched_z, tx)
    x, y = _rotate(yaw, rolled_x, pitched_y)
    down = -rolled_z
    x, y = x / down, y / down
    # a rotation by an angle changes (a, b) by (b, -a)
    roll_x, roll_y = _rotate(yaw, -rolled_z, 0.0)
    by_roll = _differentiate_tangents((roll_x, roll_y, rolled_x), x, y, down)
    pitch_z, pitch_x = _rotate(roll, pitched_y, 0.0)
    pitch_x, pitch_y = _rotate(yaw, pitch_x, -pitched_z)
    by_pitch = _differentiate_tangents((pitch_x, pitch_y, pitch_z), x, y, down)
    by_yaw = y, -x
    by_sample = _differentiate_tangents(
        _rotate_direction(roll, pitch, yaw, rays[row, 8], rays[row, 10], 0.0), x, y, down
    )
    by_line = _differentiate_tangents(_rotate_direction(roll, pitch, yaw, rays[row, 9], rays[row, 11], 0.0), x, y, down)
    return x, y, by_roll, by_pitch, by_yaw, by_sample, by_line


def intersect_frame_height(
    constants: np.ndarray, coefficients: np.ndarray, i: int, rays: np.ndarray, row: RowIndex,
    sample: Number, line: Number, z: Number, ahead: Couple[Number],
) -> Any:  # fmt: skip
    """Return the intersection of the corrected ray of an image point with frame height z, and all derivatives.

    constants, coefficients : of `pseudo_sensor.PseudoSensor`, for many images; i : the image
    rays : (n, 18) of `pseudo_rays.compute_pseudo_rays`; row : the image point, or all of them
    sample, line : image point of the ray in ``row``, px; z : height in the sensor frame, m
    ahead : px in sample and line from it to the image point whose ray is wanted and is extrapolated linearly

    Result: (x, y) m; the derivatives of x and those of y by the seven quantities; (xs, xl, ys, yl) by sample and line;
    (x, y) by z; and the terms (1, u, v) of the corrections. The sag of the ray is not corrected.
    """
    to_sample, to_line = ahead
    u = (sample + to_sample - constants[i, 12]) / constants[i, 14]
    v = (line + to_line - constants[i, 13]) / constants[i, 15]
    a = coefficients
    dx = a[i, 0, 0] + a[i, 0, 1] * u + a[i, 0, 2] * v
    dy = a[i, 1, 0] + a[i, 1, 1] * u + a[i, 1, 2] * v
    dh = a[i, 2, 0] + a[i, 2, 1] * u + a[i, 2, 2] * v
    roll, pitch = a[i, 3, 0] + a[i, 3, 1] * u + a[i, 3, 2] * v, a[i, 4, 0] + a[i, 4, 1] * u + a[i, 4, 2] * v
    yaw, psi_z = a[i, 5, 0] + a[i, 5, 1] * u + a[i, 5, 2] * v, a[i, 6, 0] + a[i, 6, 1] * u + a[i, 6, 2] * v

    x, y, by_roll, by_pitch, by_yaw, by_sample, by_line = _rotate_ray(rays, row, ahead, roll, pitch, yaw)

    # extend the ray from the station to z, then rotate by psi_z about the middle of the image
    drop = rays[row, 16] + rays[row, 17] * to_line + dh - z
    flat_x = rays[row, 0] + rays[row, 4] * to_sample + rays[row, 5] * to_line + dx + drop * x
    flat_y = rays[row, 1] + rays[row, 6] * to_sample + rays[row, 7] * to_line + dy + drop * y
    cos, sin = np.cos(psi_z), np.sin(psi_z)
    share = (rays[row, 14] - z) / rays[row, 15]
    bow, bow_by_z = 4.0 * share * (1.0 - share), -4.0 * (1.0 - 2.0 * share) / rays[row, 15]
    xy = cos * flat_x + sin * flat_y + bow * rays[row, 12], cos * flat_y - sin * flat_x + bow * rays[row, 13]
    along_x, along_y = cos * x + sin * y, cos * y - sin * x
    x_by = (
        cos,
        sin,
        along_x,
        drop * (cos * by_roll[0] + sin * by_roll[1]),
        drop * (cos * by_pitch[0] + sin * by_pitch[1]),
        drop * (cos * by_yaw[0] + sin * by_yaw[1]),
        cos * flat_y - sin * flat_x,
    )
    y_by = (
        -sin,
        cos,
        along_y,
        drop * (cos * by_roll[1] - sin * by_roll[0]),
        drop * (cos * by_pitch[1] - sin * by_pitch[0]),
        drop * (cos * by_yaw[1] - sin * by_yaw[0]),
        -cos * flat_x - sin * flat_y,
    )
    by_z = bow_by_z * rays[row, 12] - along_x, bow_by_z * rays[row, 13] - along_y

    # derivatives by the image point: through its ray, and through the terms of the corrections
    sample_x, sample_y = rays[row, 4] + drop * by_sample[0], rays[row, 6] + drop * by_sample[1]
    line_x = rays[row, 5] + drop * by_line[0] + x * rays[row, 17]
    line_y = rays[row, 7] + drop * by_line[1] + y * rays[row, 17]
    xs, ys = cos * sample_x + sin * sample_y, cos * sample_y - sin * sample_x
    xl, yl = cos * line_x + sin * line_y, cos * line_y - sin * line_x
    for k in range(7):
        along_sample, along_line = a[i, k, 1] / constants[i, 14], a[i, k, 2] / constants[i, 15]
        xs, xl = xs + x_by[k] * along_sample, xl + x_by[k] * along_line
        ys, yl = ys + y_by[k] * along_sample, yl + y_by[k] * along_line
    return xy, x_by, y_by, (xs, xl, ys, yl), by_z, (1.0, u, v)


def linearise_by_rays(
    quantities: np.ndarray,
    constants: np.ndarray,
    coefficients: np.ndarray,
    i: int,
    rays: np.ndarray,
    xy: np.ndarray,
    row: RowIndex,
    position: Triple[Number],
    axes: tuple[Triple[Number], Triple[Number], Triple[Number]],
    computed: np.ndarray,
    by_ground: np.ndarray,
    by_quantity: np.ndarray,
    terms: np.ndarray,
    a: RowIndex,
) -> None:
    """Write the observation equations of an image point; one formula for compiled loops and NumPy.

    quantities : (q,) the quantities that are corrected
    constants, coefficients, i, rays, row : as in `intersect_frame_height`; xy : (n, 2) observed, px
    position, axes : of the ground point: geocentric, and the unit vectors east, north, up there
    computed, by_ground, by_quantity, terms : arrays that receive the equations; a : row, or all rows
    """
    c = constants
    x, y, z = position[0] - c[i, 9], position[1] - c[i, 10], position[2] - c[i, 11]
    place_x = c[i, 0] * x + c[i, 1] * y + c[i, 2] * z
    place_y = c[i, 3] * x + c[i, 4] * y + c[i, 5] * z
    place_z = c[i, 6] * x + c[i, 7] * y + c[i, 8] * z
    none = 0.0 * place_z
    meeting, _, _, by_image, _, _ = intersect_frame_height(
        constants,
        coefficients,
        i,
        rays=rays,
        row=row,
        sample=xy[row, 0],
        line=xy[row, 1],
        z=place_z,
        ahead=(none, none),
    )
    xs, xl, ys, yl = by_image
    determinant = xs * yl - xl * ys
    miss_x, miss_y = place_x - meeting[0], place_y - meeting[1]
    ahead = (yl * miss_x - xl * miss_y) / determinant, (xs * miss_y - ys * miss_x) / determinant
    # the derivatives after the step are those of the projection, also for large residuals
    meeting, x_by, y_by, by_image, by_z, basis = intersect_frame_height(
        constants, coefficients, i, rays=rays, row=row, sample=xy[row, 0], line=xy[row, 1], z=place_z, ahead=ahead
    )
    xs, xl, ys, yl = by_image
    determinant = xs * yl - xl * ys
    sample_x, sample_y, line_x, line_y = yl / determinant, -xl / determinant, -ys / determinant, xs / determinant
    miss_x, miss_y = place_x - meeting[0], place_y - meeting[1]
    computed[a, 0] = xy[row, 0] + ahead[0] + sample_x * miss_x + sample_y * miss_y
    computed[a, 1] = xy[row, 1] + ahead[1] + line_x * miss_x + line_y * miss_y
    for k in range(3):
        e = axes[k]
        up = c[i, 6] * e[0] + c[i, 7] * e[1] + c[i, 8] * e[2]
        along_x = c[i, 0] * e[0] + c[i, 1] * e[1] + c[i, 2] * e[2] - by_z[0] * up
        along_y = c[i, 3] * e[0] + c[i, 4] * e[1] + c[i, 5] * e[2] - by_z[1] * up
        by_ground[a, 0, k] = sample_x * along_x + sample_y * along_y
        by_ground[a, 1, k] = line_x * along_x + line_y * along_y
    for k in range(len(quantities)):
        x, y = x_by[quantities[k]], y_by[quantities[k]]
        by_quantity[a, 0, k] = -sample_x * x - sample_y * y
        by_quantity[a, 1, k] = -line_x * x - line_y * y
    for m in range(terms.shape[1]):
        terms[a, m] = basis[m]


#: Functions that compiled loops call.
CORRECTION_FORMULAS = (
    _rotate,
    _differentiate_tangents,
    _rotate_direction,
    _rotate_ray,
    intersect_frame_height,
    linearise_by_rays,
)

"""The rational polynomial camera (RPC00B): image coordinates are ratios of cubic polynomials of ground coordinates.

With normalised coordinates L = (lon - LONG_OFF) / LONG_SCALE, and P (lat) and H (height) in the same way::

    line   = LINE_OFF + LINE_SCALE * Num_L(L, P, H) / Den_L(L, P, H)
    sample = SAMP_OFF + SAMP_SCALE * Num_S(L, P, H) / Den_S(L, P, H)

(thesis eq. 5.1; term order of STDI-0002, appendix E, RPC00B). Image coordinates are ``(sample, line)`` with
(0, 0) the centre of the first pixel, ground coordinates ``(lon, lat, height)`` in degrees and ellipsoidal metres.

Points are evaluated in parts with buffers of constant size (`rpc_terms`). Crops can have normalised image coordinates
far outside [-1, 1]: no coordinates are clamped.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ..foundation.errors import InputError
from ..ground.geodesy import LocalFrame, metres_per_degree, wrap_degrees
from .rpc_terms import DERIVATIVES, Solver, Workspace, chunks, monomials, slopes_of_ratios

if TYPE_CHECKING:
    import rasterio.rpc


class Localization(NamedTuple):
    """Ground points of `RPC.localize`, NaN where ``converged`` is False."""

    ground: np.ndarray
    converged: np.ndarray


class Rays(NamedTuple):
    """Straight pseudo light rays in a local frame: ``origin + t * direction`` (thesis eqs. 4.10-4.11)."""

    origin: np.ndarray
    direction: np.ndarray


@dataclass(frozen=True, eq=False)
class RPC:
    """A rational polynomial camera; immutable.

    The coefficients are in the order of RPC00B (NIMA, STDI-0002).

    Parameters
    ----------
    line_off, samp_off : float
        Image position (px, 0 is the centre of the first pixel) that normalises to 0.
    lat_off, long_off, height_off : float
        Ground position (degrees, ellipsoidal metres) with normalised coordinates 0.
    line_scale, samp_scale : float
        Pixels that normalise to 1.
    lat_scale, long_scale, height_scale : float
        Degrees and metres that normalise to 1.
    line_num, line_den, samp_num, samp_den : (20,) ndarray
        Coefficients of the numerators and denominators.
    err_bias, err_rand : float, optional
        The vendor's accuracy terms in metres; None if not given.
    """

    line_off: float
    samp_off: float
    lat_off: float
    long_off: float
    height_off: float
    line_scale: float
    samp_scale: float
    lat_scale: float
    long_scale: float
    height_scale: float
    line_num: np.ndarray
    line_den: np.ndarray
    samp_num: np.ndarray
    samp_den: np.ndarray
    err_bias: float | None = None
    err_rand: float | None = None

    def __post_init__(self) -> None:
        # through __dict__, for speed: a large block has tens of thousands of RPCs
        for name, value in self.__dict__.items():
            if name.endswith(("_num", "_den")):
                array = np.array(value, dtype=np.float64)
                if array.shape != (20,):
                    raise ValueError(f"{name} has {array.size} coefficients, 20 are needed")
                array.flags.writeable = False
                self.__dict__[name] = array
            elif value is not None:
                self.__dict__[name] = float(value)

    def __repr__(self) -> str:
        return f"<RPC around {self.lat_off:.4f} N, {self.long_off:.4f} E, {self.height_off:.0f} m>"

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, RPC):
            return NotImplemented
        return all(np.array_equal(getattr(self, f.name), getattr(other, f.name)) for f in fields(self))

    def __hash__(self) -> int:
        return hash((self.lat_off, self.long_off, self.line_off, self.line_num.tobytes(), self.samp_num.tobytes()))

    # ---- rasterio ----------------------------------------------------------------------------------------------

    @classmethod
    def from_rasterio(cls, source: Any) -> RPC:
        """Return the RPC of a rasterio dataset, or of its ``rpcs``.

        Rasterio's RPCs count pixels from the centre of the first pixel, too (its transformers from the corner).

        Parameters
        ----------
        source : rasterio.DatasetReader or rasterio.rpc.RPC
            An open dataset, or its RPC.

        Returns
        -------
        RPC
            ``err_bias`` and ``err_rand`` below 0, which mean unknown, are None.

        Raises
        ------
        InputError
            The dataset has no RPC.
        """
        rpcs = getattr(source, "rpcs", source)
        if rpcs is None:
            raise InputError(f"{source.name}: the dataset has no RPC: read the RPC's file with read_rpc")
        values = {name: getattr(rpcs, theirs) for name, theirs in RASTERIO_NAMES.items()}
        errors = {name: values[name] for name in ("err_bias", "err_rand")}
        return cls(**values | {name: None if (value or 0.0) < 0.0 else value for name, value in errors.items()})

    def to_rasterio(self) -> rasterio.rpc.RPC:
        """Return the RPC for rasterio: for ``dataset.rpcs = …``, or its ``RPCTransformer``.

        Nothing else of HRSI needs rasterio, so that an `ImportError` is raised if it is not installed.

        Returns
        -------
        rasterio.rpc.RPC
            The RPC with the same numbers.
        """
        import rasterio.rpc

        return rasterio.rpc.RPC(
            **{theirs: np.array(getattr(self, name)).tolist() for name, theirs in RASTERIO_NAMES.items()}
        )

    # ---- derived constants -------------------------------------------------------------------------------------

    @cached_property
    def _ground_off(self) -> np.ndarray:
        return np.array([self.long_off, self.lat_off, self.height_off])

    @cached_property
    def _ground_scale(self) -> np.ndarray:
        return np.array([self.long_scale, self.lat_scale, self.height_scale])

    @cached_property
    def _image_off(self) -> np.ndarray:
        return np.array([self.samp_off, self.line_off])

    @cached_property
    def _image_scale(self) -> np.ndarray:
        return np.array([self.samp_scale, self.line_scale])

    @cached_property
    def polynomials(self) -> np.ndarray:
        """``(4, 20)``: sample and line numerators, then sample and line denominators."""
        return np.stack([self.samp_num, self.line_num, self.samp_den, self.line_den])

    @cached_property
    def derivatives(self) -> np.ndarray:
        """``(12, 10)``: derivatives of the four polynomials by L, then by P, then by H."""
        return np.concatenate([self.polynomials @ matrix for matrix in DERIVATIVES])

    @property
    def height_range(self) -> tuple[float, float]:
        """Lowest and highest ellipsoidal height (m) of the RPC's normalised range."""
        return self.height_off - abs(self.height_scale), self.height_off + abs(self.height_scale)

    def shift(self, sample: float, line: float) -> RPC:
        """Return the RPC whose image coordinates are larger by ``sample`` and ``line`` pixels; exact.

        Parameters
        ----------
        sample, line : float
            Pixels to add to the image coordinates.

        Returns
        -------
        RPC
            The shifted camera.
        """
        return replace(self, samp_off=self.samp_off + sample, line_off=self.line_off + line)

    def resample(self, step: tuple[float, float], first: tuple[float, float]) -> RPC:
        """Return the RPC of a resampled image whose pixel x is at ``first + step * x`` in this one; exact.

        Parameters
        ----------
        step : tuple of float
            Sample and line from one pixel to the next, in pixels of this image; negative in a mirrored image.
        first : tuple of float
            Sample and line of the centre of the first pixel in this image.

        Returns
        -------
        RPC
            RPC with new OFF and SCALE; the sign of a negative step is in the numerator, since SCALE has to be positive.
        """
        return replace(
            self,
            samp_off=(self.samp_off - first[0]) / step[0],
            line_off=(self.line_off - first[1]) / step[1],
            samp_scale=self.samp_scale / abs(step[0]),
            line_scale=self.line_scale / abs(step[1]),
            samp_num=self.samp_num * np.sign(step[0]),
            line_num=self.line_num * np.sign(step[1]),
        )

    # ---- evaluation --------------------------------------------------------------------------------------------

    def _normalise(self, ground: np.ndarray, out: np.ndarray) -> None:
        """Write normalised ground coordinates of ``(n, 3)`` points to ``out (3, n)``, longitudes wrapped at 180."""
        for axis in range(3):
            np.subtract(ground[:, axis], self._ground_off[axis], out=out[axis])
        if np.abs(out[0]).max(initial=0.0) > 180.0:
            out[0] = wrap_degrees(out[0])
        out /= self._ground_scale[:, None]

    def _denormalise(self, ratios: np.ndarray, image: np.ndarray) -> None:
        """Write image coordinates of normalised ``ratios (2, n)`` to ``image (n, 2)``; overwrites ``ratios``."""
        ratios *= self._image_scale[:, None]
        ratios += self._image_off[:, None]
        image[:, 0], image[:, 1] = ratios  # column by column: five times as fast as a transposed copy

    def normalise(self, ground: np.ndarray) -> np.ndarray:
        """Return normalised lon, lat and height ``(3, n)`` of ground points ``(n, 3)``: [-1, 1] in the RPC's domain.

        Parameters
        ----------
        ground : (n, 3) ndarray
            Lon, lat in degrees, ellipsoidal height in metres.

        Returns
        -------
        (3, n) ndarray
            Without unit; the numerators and denominators are polynomials of these coordinates.
        """
        ground = _check_points(ground, 3, "ground")
        normalised = np.empty((3, len(ground)))
        self._normalise(ground, out=normalised)
        return normalised

    def denominators(self, ground: np.ndarray) -> np.ndarray:
        """Return the sample and line denominators ``(2, n)`` at ground points ``(n, 3)``; near 0 an RPC is unusable.

        Parameters
        ----------
        ground : (n, 3) ndarray
            Lon, lat in degrees, ellipsoidal height in metres.

        Returns
        -------
        (2, n) ndarray
            The denominators of sample and of line; they are close to 1 in the centre of the domain.
        """
        return np.asarray(self.polynomials[2:] @ monomials(self.normalise(ground)))

    def project(self, ground: np.ndarray) -> np.ndarray:
        """Return image points ``(n, 2)`` (sample, line) of ground points ``(n, 3)`` (lon, lat, height).

        Parameters
        ----------
        ground : (n, 3) ndarray
            Lon, lat in degrees, ellipsoidal height in metres.

        Returns
        -------
        (n, 2) ndarray
            Sample, line in pixels.
        """
        ground = _check_points(ground, 3, "ground")
        image = np.empty((len(ground), 2))

        work = Workspace(len(ground))
        with np.errstate(all="ignore"):
            for part in chunks(len(ground)):
                terms = work.terms(part.stop - part.start)
                self._normalise(ground[part], out=terms[1:4])
                self._denormalise(work.ratios(self.polynomials, terms)[0], image[part])
        return image

    def project_with_jacobian(self, ground: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return image points ``(n, 2)`` and their derivatives ``(n, 2, 3)``, in px per degree, degree and metre.

        Parameters
        ----------
        ground : (n, 3) ndarray
            Lon, lat in degrees, ellipsoidal height in metres.

        Returns
        -------
        tuple of (n, 2) ndarray and (n, 2, 3) ndarray
            Sample, line in pixels; their derivatives by lon, lat and height.
        """
        ground = _check_points(ground, 3, "ground")
        image, jacobian = np.empty((len(ground), 2)), np.empty((len(ground), 2, 3))
        scale = self._image_scale[:, None] / self._ground_scale[None, :]

        work = Workspace(len(ground))
        with np.errstate(all="ignore"):
            for part in chunks(len(ground)):
                terms = work.terms(part.stop - part.start)
                self._normalise(ground[part], out=terms[1:4])
                ratios, denominators = work.ratios(self.polynomials, terms)
                slopes = slopes_of_ratios(self.derivatives, terms, ratios, denominators)
                for row, column in np.ndindex(2, 3):
                    np.multiply(slopes[column, row], scale[row, column], out=jacobian[part, row, column])
                self._denormalise(ratios, image[part])
        return image, jacobian

    def project_with_metric_jacobian(self, ground: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Project ground points, with derivatives by metres east, north and up at each point.

        Parameters
        ----------
        ground : (n, 3) ndarray
            Lon, lat in degrees, ellipsoidal height in metres.

        Returns
        -------
        tuple of (n, 2) ndarray and (n, 2, 3) ndarray
            Sample, line in pixels; their derivatives in pixels per metre.
        """
        image, jacobian = self.project_with_jacobian(ground)
        return image, jacobian / metres_per_degree(ground)[:, None, :]

    def px_per_m(self, ground: np.ndarray) -> np.ndarray:
        """Return the number of pixels per metre on the ground, the geometric mean of the two principal directions.

        Parameters
        ----------
        ground : (n, 3) ndarray
            Lon, lat in degrees, ellipsoidal height in metres.

        Returns
        -------
        (n,) ndarray
            Pixels per metre; the inverse is the side of a square with the ground area of a pixel.
        """
        _, by_ground = self.project_with_metric_jacobian(ground)
        return np.asarray(np.sqrt(np.abs(np.linalg.det(by_ground[:, :, :2]))))

    # ---- inverse -----------------------------------------------------------------------------------------------

    @cached_property
    def _solver(self) -> Solver:
        return Solver(self.polynomials, self._image_scale)

    def localize(self, image: np.ndarray, height_m: np.ndarray | float) -> Localization:
        """Return the ground points of image points at given heights.

        Newton iteration, per point, until the image point is reproduced to 1e-9 px (or to the limit of rounding, at
        most 1e-8 px). Points whose iteration fails are NaN and not ``converged``.

        Parameters
        ----------
        image : (n, 2) ndarray
            Sample, line in pixels.
        height_m : float or (n,) ndarray
            Ellipsoidal heights in metres.

        Returns
        -------
        Localization
            Ground points (lon, lat, height), and which of them converged.
        """
        image = _check_points(image, 2, "image")
        heights = np.broadcast_to(np.asarray(height_m, dtype=np.float64), (len(image),))
        ground, converged = np.empty((len(image), 3)), np.empty(len(image), dtype=bool)

        work = Workspace(len(image))
        with np.errstate(all="ignore"):
            for part in chunks(len(image)):
                target = np.empty((2, part.stop - part.start))
                for axis in (0, 1):
                    np.subtract(image[part, axis], self._image_off[axis], out=target[axis])
                target /= self._image_scale[:, None]
                lonlat, solved = self._solver.solve(target, (heights[part] - self.height_off) / self.height_scale, work)
                lonlat *= self._ground_scale[:2, None]
                lonlat += self._ground_off[:2, None]
                if np.abs(lonlat[0]).max() > 180.0:
                    outside = np.abs(lonlat[0]) > 180.0
                    lonlat[0, outside] = wrap_degrees(lonlat[0, outside])
                ground[part, 0], ground[part, 1], ground[part, 2] = *lonlat, heights[part]
                ground[part][~solved] = np.nan
                converged[part] = solved
        return Localization(ground, converged)

    # ---- rays --------------------------------------------------------------------------------------------------

    def rays(
        self, image: np.ndarray, frame: LocalFrame, heights: tuple[float, float] | None = None
    ) -> tuple[Rays, np.ndarray]:
        """Return the pseudo light rays of image points in a local frame, and a mask of those that exist.

        Each ray passes through the ground positions of the image point at two heights (default: the ends of the RPC's
        height range); ``origin`` is the upper one, and ``direction`` points down, scaled to one metre of descent
        along the up axis of the frame. Thesis section 4.3, step 1.

        Parameters
        ----------
        image : (n, 2) ndarray
            Sample, line in pixels.
        frame : LocalFrame
            The frame of the rays' origins and directions, in metres.
        heights : tuple of float, optional
            The two ellipsoidal heights in metres; by default the ends of the RPC's range.

        Returns
        -------
        tuple of Rays and (n,) ndarray
            The rays, and a mask of those that exist.
        """
        low, high = heights or self.height_range
        upper, lower = self.localize(image, high), self.localize(image, low)
        top = frame.from_ground(upper.ground)
        down = frame.from_ground(lower.ground) - top
        return Rays(top, down / -down[:, 2:]), upper.converged & lower.converged


def _check_points(points: np.ndarray, columns: int, name: str) -> np.ndarray:
    array = np.asarray(points, dtype=np.float64)
    if array.ndim != 2 or array.shape[1] != columns:
        raise ValueError(f"{name} points have shape {array.shape}, (n, {columns}) is needed")
    return array


#: Field of `RPC` -> its name in rasterio.
RASTERIO_NAMES = {
    field.name: f"{field.name}_coeff" if field.name.endswith(("_num", "_den")) else field.name for field in fields(RPC)
}

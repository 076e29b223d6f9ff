"""The vendor's part: rational polynomials fitted to a physical camera, as they come with an image."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ...camera.rpc import RPC
from ...camera.rpc_fit import fit_rpc
from .pushbroom import PushbroomCamera
from .sensors import AccuracyStatement
from .world import constant, constants


@constants
class VENDOR:
    """Grids to which a vendor's RPC is fitted and on which it is tested."""

    control_grid: tuple[int, int, int] = constant((15, 15, 7), "nodes", "samples, lines and heights of the fit")
    check_grid: tuple[int, int, int] = constant(
        (22, 23, 10), "nodes", "samples, lines and heights of the test, without common nodes"
    )
    height_margin_m: float = constant(50.0, "m", "margin below and above the range of heights")
    resolved_px: float = constant(2e-8, "px", "smallest residual that the fit resolves")
    border: float = constant(0.02, "", "margin of the grid around the image, relative to its size")


@dataclass(frozen=True, eq=False)
class VendorRPC:
    """An RPC and how far it is from the physical camera it was fitted to, on the independent grid.

    Parameters
    ----------
    rpc : RPC
        The camera as it is delivered.
    max_px, rms_px : float
        Largest and RMS difference; the largest is never below `VENDOR.resolved_px`: the camera's own two
        directions agree no better.
    """

    rpc: RPC
    max_px: float
    rms_px: float


def fit_camera(camera: PushbroomCamera, height_range_m: tuple[float, float]) -> VendorRPC:
    """Return the RPC of a camera over a range of heights.

    Parameters
    ----------
    camera : PushbroomCamera
        The camera.
    height_range_m : tuple of float
        Lowest and highest ellipsoidal height; they are widened by 50 m.

    Returns
    -------
    VendorRPC
        The RPC, and how well it fits.
    """
    low, high = height_range_m[0] - VENDOR.height_margin_m, height_range_m[1] + VENDOR.height_margin_m
    image, ground = make_control_grid(camera, VENDOR.control_grid, (low, high), VENDOR.border)
    rpc = fit_rpc(ground, image).rpc
    image, ground = make_control_grid(camera, VENDOR.check_grid, (low, high), 0.0)
    distance = np.hypot(*(rpc.project(ground) - image).T)
    return VendorRPC(rpc, max(float(distance.max()), VENDOR.resolved_px), float(np.sqrt(np.mean(distance**2))))


def make_accuracy_statement(rpc: RPC, camera: PushbroomCamera, accuracy: AccuracyStatement, scale: float) -> RPC:
    """Return the RPC with ERR_BIAS, the standard deviation of each horizontal coordinate that the vendor states.

    It follows from the sensor's accuracy, ``scale`` times: an attitude error moves the ground by the distance across
    the line of sight, and by more along it where that is oblique. An accuracy of 0 is not stated.
    """
    if scale <= 0.0:
        return rpc
    position = camera.exterior(np.array([camera.middle[1]]))[0][0]
    sight = camera.centre - position
    distance = float(np.linalg.norm(sight))
    cosine = -float(sight @ camera.normal) / distance
    by_attitude = distance * accuracy.attitude_rad * np.sqrt(0.5 + 0.5 / cosine**2)
    return replace(rpc, err_bias=scale * float(np.hypot(accuracy.position_m, by_attitude)))


def fit_multispectral_rpc(rpc: RPC, ratio: int) -> RPC:
    """Return the exact RPC of larger pixels with the same upper left corner.

    Parameters
    ----------
    rpc : RPC
        Of the panchromatic pixels.
    ratio : int
        Panchromatic pixels along each side of a larger one.

    Returns
    -------
    RPC
        Of the larger pixels.
    """
    shift = (ratio - 1) / 2.0
    return rpc.resample((ratio, ratio), (shift, shift))


def make_control_grid(
    camera: PushbroomCamera, counts: tuple[int, int, int], heights_m: tuple[float, float], border: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return image ``(n, 2)`` and ground points ``(n, 3)`` of a grid over the image and its range of heights."""
    axes = [
        (size - 1) / 2.0 + (1.0 + border) * size / 2.0 * np.linspace(-1.0, 1.0, count)
        for size, count in zip(camera.size, counts[:2], strict=True)
    ]
    sample, line, height = np.meshgrid(*axes, np.linspace(*heights_m, counts[2]), indexing="ij")
    image = np.column_stack([sample.ravel(), line.ravel()])
    return image, camera.image_to_ground(image, height.ravel())

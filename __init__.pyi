# Made by scripts/make_stubs.py: change the declarations or the package, and run it again.

import os
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Literal, Protocol, TypeAlias, overload

import numpy as np

from .hrsi_engine import MODELS as MODELS
from .hrsi_engine import RPC as RPC
from .hrsi_engine import Block as Block
from .hrsi_engine import GroundPoints as GroundPoints
from .hrsi_engine import HrsiError as HrsiError
from .hrsi_engine import Image as Image
from .hrsi_engine import ImagePoints as ImagePoints
from .hrsi_engine import Role as Role
from .hrsi_engine import read_rpc as read_rpc
from .hrsi_engine import refine_rpc as refine_rpc
from .hrsi_engine.foundation.progress import Progress
from .hrsi_engine.io.rasters.images import ImageSource
from .hrsi_engine.io.rpc_files import FoundRpc
from .plugin.plugin import HrsiPlugin
from .processing_algorithms.facade.result import Result as Result
from .processing_algorithms.facade.result import read_result as read_result

class Table(Protocol):
    """A table with columns by name: of pandas, GeoPandas, Polars …"""

    @property
    def columns(self) -> Any: ...
    def __getitem__(self, key: Any, /) -> Any: ...

Path: TypeAlias = str | os.PathLike[str]
Images: TypeAlias = ImageSource | Image | RPC | Block | Sequence[ImageSource | Image]
RasterSource: TypeAlias = ImageSource
TableOrFile: TypeAlias = Path | Table | Mapping[str, Any] | GroundPoints | ImagePoints
Points: TypeAlias = TableOrFile | np.ndarray

def classFactory(iface: Any) -> HrsiPlugin: ...  # noqa: N802
@overload
def open(
    source: ImageSource | Image | np.ndarray, rpc: RPC | FoundRpc | Image | Path | None = None, id: str | None = None
) -> Image:
    """Open an image with its RPC, or several.

    Parameters
    ----------
    source : path, rasterio dataset, xarray object, array, Image, or a sequence of them
        An image that GDAL opens, or an RPC file alone (``_RPC.TXT``, ``.RPB``, DIMAP or ISD XML, ``.geom``); an array
        ``(lines, samples)`` of grey values, which needs ``rpc``.
    rpc : RPC or path, optional
        A camera to be used instead of the image's own: an RPC, the result of `read_rpc`, or a file.
    id : str, optional
        Name in the block; by default the file's stem without a trailing ``_RPC``.

    Returns
    -------
    Image or list of Image
        With ``rpc``, ``size`` and access to the pixels; a list for a sequence.

    Raises
    ------
    InputError
        The file is missing, is neither an image nor an RPC file, or has no RPC."""
    ...

@overload
def open(source: list[Any] | tuple[Any, ...], rpc: None = None, id: None = None) -> list[Image]: ...
def triangulate(
    images: Images,
    *,
    gcps: Points | None = None,
    image_points: Points | None = None,
    gcp_ids: str | Iterable[str] | None = None,
    check_ids: str | Iterable[str] | None = None,
    ground_crs: str | None = None,
    height_datum: str = "layer",
    gcp_epoch: float | None = None,
    strict_datum: bool = False,
    sigma_image: float = 0.5,
    sigma_gcp_xy: float = 0.2,
    sigma_gcp_h: float = 0.3,
    tie_points: Points = "auto",
    dem: RasterSource | None = None,
    dem_datum: str | None = None,
    surface: Points | None = None,
    surface_datum: str | None = None,
    sigma_surface: float | None = None,
    laser: Points | None = None,
    laser_datum: str = "ellipsoidal",
    reference: RasterSource | None = None,
    reference_sigma: float | None = None,
    reference_band: int | None = None,
    reference_points: int = 300,
    reference_search: float = 1024.0,
    threads: int = 0,
    add_to: str | None = None,
    earlier_cameras: Literal["free", "observed"] = "free",
    search_margin: float = 128.0,
    cells: int = 12,
    per_cell: int = 0,
    dense: bool = False,
    partners: int = 8,
    min_overlap: float = 0.02,
    matches: Points | None = None,
    scheduler: str | None = None,
    scheduler_ca: Path | None = None,
    scheduler_certificate: Path | None = None,
    scheduler_key: Path | None = None,
    work_dir: str | None = None,
    model: Literal[
        "auto",
        "generic",
        "none",
        "shift",
        "shift-drift",
        "conformal",
        "affine",
        "quadratic",
        "ground-linear",
        "ground-quadratic",
        "object-shift",
        "object-scale-shift",
        "object-affine",
        "generic-position",
        "generic-shift",
        "generic-12",
        "generic-affine",
        "generic-full",
    ] = "auto",
    robust: Literal["none", "huber", "cauchy", "tukey"] = "none",
    reject: float = 4.0,
    check_as_ties: bool = False,
    test_sigmas: bool = True,
    variance_components: bool = False,
    variance_groups: Literal["kind-sensor", "kind", "sensor", "image", "kind-image"] = "kind-sensor",
    sensor_images: str | Iterable[str | Iterable[str]] = (),
    cross_validate: bool = False,
    fixed_images: str | Iterable[str] = (),
    shared_images: str | Iterable[str | Iterable[str]] = (),
    sigma_dem: float | None = None,
    surface_search: float = 100.0,
    surface_kind: Literal["dsm", "dtm"] = "dsm",
    laser_reach: float = 25.0,
    sigma_laser: float = 0.1,
    sigma_shift: float | None = None,
    sigma_drift: float | None = None,
    jitter: str = "none",
    hold_out: float = 0.1,
    output_dir: Path | None = None,
    overwrite: bool = False,
    write: Literal["copy", "resampled", "in-place", "vrt", "sidecar", "none"] = "copy",
    force_write: bool = False,
    residual_crs: Literal["both", "wgs84", "utm"] = "both",
    report: bool = True,
    title: str | None = None,
    client: str | None = None,
    place: str | None = None,
    stac: bool = False,
    progress: Progress | None = None,
) -> Result:
    """Refined RPCs of a block from tie points and GCPs, with residual layers and a report.

    Finds tie points between overlapping images, reads GCPs from a vector layer or CSV, corrects all
    RPCs in one bundle block adjustment and reports the accuracy at check points. GCPs can also be
    measured in an orthoimage (``reference``, with ``dem``). Without GCPs the position of the block
    follows from its RPCs, or from the relief of a ``surface``, and the relative accuracy of the images
    is improved. The refined images can be used with gdalwarp -rpc.

    Parameters
    ----------
    images : path or Image or sequence of them
        Images with RPC, RPC files alone (_RPC.TXT, .RPB, XML, .geom), or STAC items (.json).
    gcps : path or table or array or GroundPoints or ImagePoints, optional
        Ground points with known position: a vector layer or CSV; FILE|columns=id=NAME,… if its fields
        have other names.
    image_points : path or table or array or GroundPoints or ImagePoints, optional
        Image measurements of the points; ground positions in this file are not used.
    gcp_ids : sequence of str, optional
        Ids of the GCPs; all other points with known position are check points.
    check_ids : sequence of str, optional
        Ids of the check points; with ``gcp_ids`` too, all other points with known position are not
        used.
    ground_crs : str, optional
        CRS of ground points whose file does not name one (EPSG:code or WKT).
    height_datum : str, optional
        Height datum of ground points and DEM: layer (from their CRS), ellipsoidal, egm96, egm2008 or
        the file of a geoid grid (default layer).
    gcp_epoch : float, optional
        Year of the images (2015.4), for the plate motion between WGS84 and the datum of points and DEM
        (ETRS89, GDA2020, NAD83); by default the two are treated as equal, and the error is included in
        the accuracy (at least 1957).
    strict_datum : bool, optional
        Stop if the geoid or the grid of a better coordinate operation is not installed, instead of
        using the next best one (default no).
    sigma_image : float, optional
        Standard deviation of image points without one in their file (unit px; at least 1e-06; default
        0.5).
    sigma_gcp_xy : float, optional
        Standard deviation of each horizontal coordinate of GCPs without one in their file (unit m; at
        least 1e-06; default 0.2).
    sigma_gcp_h : float, optional
        Standard deviation of the heights of GCPs without one in their file (unit m; at least 1e-06;
        default 0.3).
    tie_points : path or table or array or GroundPoints or ImagePoints, optional
        Tie points: auto finds them in the images, none uses none, FILE or the folder of a result
        contains them (default auto).
    dem : path or rasterio dataset, optional
        DEM of the ground, in any CRS.
    dem_datum : str, optional
        Height datum of the DEM, if it differs from ``height_datum``.
    surface : path or table or array or GroundPoints or ImagePoints, optional
        Surface that constrains the block in plan and height by its relief, instead of ``dem`` with
        ``sigma_dem``: a raster, a lidar point cloud (LAS, LAZ), a layer of points with heights, a
        granule of ICESat-2 or GEDI.
    surface_datum : str, optional
        Height datum of the surface, if it differs from ``height_datum``.
    sigma_surface : float, optional
        Standard deviation of the heights of the surface, four fifths of it common to all heights; by
        default a value for its cell size (unit m; at least 1e-06).
    laser : path or table or array or GroundPoints or ImagePoints, optional
        Laser points whose heights constrain the block; image points are not needed: a granule of
        ICESat-2 (ATL06, ATL08) or GEDI L2A, GeoParquet or CSV of SlideRule, or a point layer with
        height and sigma_h.
    laser_datum : str, optional
        Height datum of laser points in a layer; heights of granules are ellipsoidal (default
        ellipsoidal).
    reference : path or rasterio dataset, optional
        Orthoimage in which GCPs are found by matching, in any CRS.
    reference_sigma : float, optional
        Standard deviation of each horizontal coordinate of the reference; by default twice its pixel
        size, at most 5 m or half a pixel (unit m; at least 1e-06).
    reference_band : int, optional
        Band of the reference; by default the mean of all (at least 1).
    reference_points : int, optional
        Windows of the reference that are searched in each image (at least 12; default 300).
    reference_search : float, optional
        Largest error of the RPCs against the reference (search distance) (unit px; at least 16; default
        1024).
    threads : int, optional
        Number of threads; 0 takes all cores (at least 0; default 0).
    add_to : str, optional
        Output directory of an earlier adjustment; the images are added to its block.
    earlier_cameras : str, optional
        Cameras of the earlier block: free (adjusted again from all measurements) or observed (with the
        values and covariances of the earlier adjustment; its points are not used again) (one of free,
        observed; default free).
    search_margin : float, optional
        Largest error of the RPCs in the search for tie points; it is increased where nothing is found
        (unit px; at least 0; default 128).
    cells : int, optional
        Every image is divided into N x N cells, over which tie points are spread evenly (at least 1; at
        most 1000; default 12).
    per_cell : int, optional
        Tie points of a cell; 0 takes 40 for images up to 2048 px, which are matched everywhere, else 2
        from a small window in the cell (at least 0; default 0).
    dense : bool, optional
        Match all of every image, with small windows first, and keep all tie points, for a terrain model
        from them (terrain points of orthorectify); takes about 15 s of one core per megapixel of a pair
        (default no).
    partners : int, optional
        Average number of images that each image is matched with: all that overlap if these are few,
        else those with the best test matches, in spanning trees of the block (at least 1; default 8).
    min_overlap : float, optional
        Smallest overlap of two images that are matched, as a share of the image (at least 0; at most 1;
        default 0.02).
    matches : path or table or array or GroundPoints or ImagePoints, optional
        Matches of another program instead of a search: .h5 of hloc, a COLMAP database, matches as text;
        each is measured again by least-squares matching and tested like matches of HRSI.
    scheduler : str, optional
        Address of a Dask scheduler whose workers find tie points or make orthoimages (they need the
        files under the same paths); by default threads of this machine are used. The block adjustment
        itself always runs in this process.
    scheduler_ca : path, optional
        Certificates (PEM) of the authority of a scheduler at tls://HOST:PORT; this and the next two
        default to the Dask configuration (distributed.comm.tls).
    scheduler_certificate : path, optional
        Client certificate (PEM) for a scheduler at tls://HOST:PORT.
    scheduler_key : path, optional
        Private key (PEM) of the client certificate, if it is not in the same file.
    work_dir : str, optional
        Directory for finished parts, which later runs use again; by default a folder in the output
        directory, which is removed at the end of a run.
    model : str, optional
        Correction model of the RPCs; auto and generic choose it from GCPs and tie points (one of auto,
        generic, none, shift, shift-drift, conformal, affine, quadratic, ground-linear, ground-
        quadratic, object-shift, object-scale-shift, object-affine, generic-position, generic-shift,
        generic-12, generic-affine, generic-full; default auto).
    robust : str, optional
        Weight function against blunders (one of none, huber, cauchy, tukey; default none).
    reject : float, optional
        Reject tie point measurements and GCPs whose test statistic exceeds this value (data snooping);
        0 rejects none (unit sigma; at least 0; default 4).
    check_as_ties : bool, optional
        Use image points of check points like tie points (their surveyed positions are never used)
        (default no).
    test_sigmas : bool, optional
        Test the sigmas of the observations with the residuals, estimate those that fail, and estimate
        the attitude drift; otherwise all remain as given (default yes).
    variance_components : bool, optional
        Estimate the sigmas of image points by kind and sensor and of GCPs from the residuals, and
        adjust with them (default no).
    variance_groups : str, optional
        Grouping of image points for the estimation of their sigmas (one of kind-sensor, kind, sensor,
        image, kind-image; default kind-sensor).
    sensor_images : sequence of sequences of str, optional
        Images of one sensor, whose image points have one sigma; groups joined by +; by default images
        of similar resolution.
    cross_validate : bool, optional
        Predict each GCP from an adjustment without it (leave-one-out) (default no).
    fixed_images : sequence of str, optional
        Reference images, whose RPCs stay as they are.
    shared_images : sequence of sequences of str, optional
        Images of one exposure, strip or orbit that get the same correction; groups joined by +.
    sigma_dem : float, optional
        Standard deviation of the heights of ``dem``, which then constrain the tie points; by default
        they are not used for this (unit m; at least 1e-06).
    surface_search : float, optional
        Search distance in plan for the relief of a surface that constrains a block without GCPs; 0: the
        surface constrains heights only (unit m; at least 0; default 100).
    surface_kind : str, optional
        Whether the heights of the DEM or surface include trees and buildings (dsm) or not (dtm) (one of
        dsm, dtm; default dsm).
    laser_reach : float, optional
        Radius around a laser point within which tie points describe the terrain, and are constrained by
        its height (unit m; at least 0.1; default 25).
    sigma_laser : float, optional
        Additional standard deviation of every laser height, added to that of its file (unit m; at least
        0; default 0.1).
    sigma_shift : float, optional
        A priori standard deviation of the shift of each image; by default 100 px with GCPs, else
        ERR_BIAS of the RPC, the published accuracy of the sensor, or 7 m on the ground (unit px; at
        least 1e-09).
    sigma_drift : float, optional
        A priori standard deviation of the attitude drift of an image; by default 1e-3 with GCPs, else
        1e-4; for models without drift the published value of the sensor, at least 3e-5; 0: no drift
        (unit px/px; at least 0).
    jitter : str, optional
        Remove jitter (vibration of the attitude) along the lines of each image: auto where residuals
        show significant waves, none, or LINES between the knots of the curves (default none).
    hold_out : float, optional
        Share of the tie points that the adjustment does not use and that check its result, in blocks
        with more than 500; 0 uses all (at least 0; at most 0.5; default 0.1).
    output_dir : path, optional
        Directory for the results; created where missing.
    overwrite : bool, optional
        Replace the results of an earlier run in the output directory (default no).
    write : str, optional
        Target of the refined RPCs: copies of the images, copies resampled without jitter, the images
        themselves (write-rpc with restore restores the original), virtual images, _RPC.TXT files, or
        none; for an RPC file without image a new _RPC.TXT is written (one of copy, resampled, in-place,
        vrt, sidecar, none; default copy).
    force_write : bool, optional
        Write the refined RPCs even if the verdict is unusable (default no).
    residual_crs : str, optional
        Coordinate systems of the residual layers (one of both, wgs84, utm; default both).
    report : bool, optional
        Write report.html (default yes).
    title : str, optional
        Title of the project, for the cover of report.html.
    client : str, optional
        Client or recipient, for the cover of report.html.
    place : str, optional
        Name of the place, for the cover of report.html.
    stac : bool, optional
        Also write a STAC item of each refined image (ID_stac.json), and one file of all items
        (stac.json) (default no).
    progress : callable, optional
        Called with a fraction and a message; False cancels.

    Returns
    -------
    Result
        The report, its tables and files. Without ``output_dir`` they go when the result does.

    Raises
    ------
    HrsiError
        What is wrong with the input, and what to do about it.
    """
    ...

def adjust(
    images: Images,
    *,
    gcps: Points | None = None,
    image_points: Points | None = None,
    gcp_ids: str | Iterable[str] | None = None,
    check_ids: str | Iterable[str] | None = None,
    ground_crs: str | None = None,
    height_datum: str = "layer",
    gcp_epoch: float | None = None,
    strict_datum: bool = False,
    sigma_image: float = 0.5,
    sigma_gcp_xy: float = 0.2,
    sigma_gcp_h: float = 0.3,
    tie_points: Points = "none",
    dem: RasterSource | None = None,
    dem_datum: str | None = None,
    surface: Points | None = None,
    surface_datum: str | None = None,
    sigma_surface: float | None = None,
    laser: Points | None = None,
    laser_datum: str = "ellipsoidal",
    add_to: str | None = None,
    earlier_cameras: Literal["free", "observed"] = "free",
    model: Literal[
        "auto",
        "generic",
        "none",
        "shift",
        "shift-drift",
        "conformal",
        "affine",
        "quadratic",
        "ground-linear",
        "ground-quadratic",
        "object-shift",
        "object-scale-shift",
        "object-affine",
        "generic-position",
        "generic-shift",
        "generic-12",
        "generic-affine",
        "generic-full",
    ] = "auto",
    robust: Literal["none", "huber", "cauchy", "tukey"] = "none",
    reject: float = 4.0,
    check_as_ties: bool = False,
    test_sigmas: bool = True,
    variance_components: bool = False,
    variance_groups: Literal["kind-sensor", "kind", "sensor", "image", "kind-image"] = "kind-sensor",
    sensor_images: str | Iterable[str | Iterable[str]] = (),
    cross_validate: bool = False,
    fixed_images: str | Iterable[str] = (),
    shared_images: str | Iterable[str | Iterable[str]] = (),
    sigma_dem: float | None = None,
    surface_search: float = 100.0,
    surface_kind: Literal["dsm", "dtm"] = "dsm",
    laser_reach: float = 25.0,
    sigma_laser: float = 0.1,
    sigma_shift: float | None = None,
    sigma_drift: float | None = None,
    jitter: str = "none",
    threads: int = 0,
    hold_out: float = 0.1,
    output_dir: Path | None = None,
    overwrite: bool = False,
    write: Literal["copy", "resampled", "in-place", "vrt", "sidecar", "none"] = "copy",
    force_write: bool = False,
    residual_crs: Literal["both", "wgs84", "utm"] = "both",
    report: bool = True,
    title: str | None = None,
    client: str | None = None,
    place: str | None = None,
    stac: bool = False,
    progress: Progress | None = None,
) -> Result:
    """Bundle block adjustment from existing image points.

    Corrects the RPCs of all images of a block in one adjustment, from GCPs, tie points or both, and
    reports the accuracy at check points. Writes refined RPCs, residual layers and a report.

    Parameters
    ----------
    images : path or Image or sequence of them
        Images with RPC, RPC files alone (_RPC.TXT, .RPB, XML, .geom), or STAC items (.json).
    gcps : path or table or array or GroundPoints or ImagePoints, optional
        Ground points with known position: a vector layer or CSV; FILE|columns=id=NAME,… if its fields
        have other names.
    image_points : path or table or array or GroundPoints or ImagePoints, optional
        Image measurements of the points; ground positions in this file are not used.
    gcp_ids : sequence of str, optional
        Ids of the GCPs; all other points with known position are check points.
    check_ids : sequence of str, optional
        Ids of the check points; with ``gcp_ids`` too, all other points with known position are not
        used.
    ground_crs : str, optional
        CRS of ground points whose file does not name one (EPSG:code or WKT).
    height_datum : str, optional
        Height datum of ground points and DEM: layer (from their CRS), ellipsoidal, egm96, egm2008 or
        the file of a geoid grid (default layer).
    gcp_epoch : float, optional
        Year of the images (2015.4), for the plate motion between WGS84 and the datum of points and DEM
        (ETRS89, GDA2020, NAD83); by default the two are treated as equal, and the error is included in
        the accuracy (at least 1957).
    strict_datum : bool, optional
        Stop if the geoid or the grid of a better coordinate operation is not installed, instead of
        using the next best one (default no).
    sigma_image : float, optional
        Standard deviation of image points without one in their file (unit px; at least 1e-06; default
        0.5).
    sigma_gcp_xy : float, optional
        Standard deviation of each horizontal coordinate of GCPs without one in their file (unit m; at
        least 1e-06; default 0.2).
    sigma_gcp_h : float, optional
        Standard deviation of the heights of GCPs without one in their file (unit m; at least 1e-06;
        default 0.3).
    tie_points : path or table or array or GroundPoints or ImagePoints, optional
        Tie points: FILE with points measured in two or more images, or folder of a result; none uses
        none (default none).
    dem : path or rasterio dataset, optional
        DEM of the ground, in any CRS.
    dem_datum : str, optional
        Height datum of the DEM, if it differs from ``height_datum``.
    surface : path or table or array or GroundPoints or ImagePoints, optional
        Surface that constrains the block in plan and height by its relief, instead of ``dem`` with
        ``sigma_dem``: a raster, a lidar point cloud (LAS, LAZ), a layer of points with heights, a
        granule of ICESat-2 or GEDI.
    surface_datum : str, optional
        Height datum of the surface, if it differs from ``height_datum``.
    sigma_surface : float, optional
        Standard deviation of the heights of the surface, four fifths of it common to all heights; by
        default a value for its cell size (unit m; at least 1e-06).
    laser : path or table or array or GroundPoints or ImagePoints, optional
        Laser points whose heights constrain the block; image points are not needed: a granule of
        ICESat-2 (ATL06, ATL08) or GEDI L2A, GeoParquet or CSV of SlideRule, or a point layer with
        height and sigma_h.
    laser_datum : str, optional
        Height datum of laser points in a layer; heights of granules are ellipsoidal (default
        ellipsoidal).
    add_to : str, optional
        Output directory of an earlier adjustment; the images are added to its block.
    earlier_cameras : str, optional
        Cameras of the earlier block: free (adjusted again from all measurements) or observed (with the
        values and covariances of the earlier adjustment; its points are not used again) (one of free,
        observed; default free).
    model : str, optional
        Correction model of the RPCs; auto and generic choose it from GCPs and tie points (one of auto,
        generic, none, shift, shift-drift, conformal, affine, quadratic, ground-linear, ground-
        quadratic, object-shift, object-scale-shift, object-affine, generic-position, generic-shift,
        generic-12, generic-affine, generic-full; default auto).
    robust : str, optional
        Weight function against blunders (one of none, huber, cauchy, tukey; default none).
    reject : float, optional
        Reject tie point measurements and GCPs whose test statistic exceeds this value (data snooping);
        0 rejects none (unit sigma; at least 0; default 4).
    check_as_ties : bool, optional
        Use image points of check points like tie points (their surveyed positions are never used)
        (default no).
    test_sigmas : bool, optional
        Test the sigmas of the observations with the residuals, estimate those that fail, and estimate
        the attitude drift; otherwise all remain as given (default yes).
    variance_components : bool, optional
        Estimate the sigmas of image points by kind and sensor and of GCPs from the residuals, and
        adjust with them (default no).
    variance_groups : str, optional
        Grouping of image points for the estimation of their sigmas (one of kind-sensor, kind, sensor,
        image, kind-image; default kind-sensor).
    sensor_images : sequence of sequences of str, optional
        Images of one sensor, whose image points have one sigma; groups joined by +; by default images
        of similar resolution.
    cross_validate : bool, optional
        Predict each GCP from an adjustment without it (leave-one-out) (default no).
    fixed_images : sequence of str, optional
        Reference images, whose RPCs stay as they are.
    shared_images : sequence of sequences of str, optional
        Images of one exposure, strip or orbit that get the same correction; groups joined by +.
    sigma_dem : float, optional
        Standard deviation of the heights of ``dem``, which then constrain the tie points; by default
        they are not used for this (unit m; at least 1e-06).
    surface_search : float, optional
        Search distance in plan for the relief of a surface that constrains a block without GCPs; 0: the
        surface constrains heights only (unit m; at least 0; default 100).
    surface_kind : str, optional
        Whether the heights of the DEM or surface include trees and buildings (dsm) or not (dtm) (one of
        dsm, dtm; default dsm).
    laser_reach : float, optional
        Radius around a laser point within which tie points describe the terrain, and are constrained by
        its height (unit m; at least 0.1; default 25).
    sigma_laser : float, optional
        Additional standard deviation of every laser height, added to that of its file (unit m; at least
        0; default 0.1).
    sigma_shift : float, optional
        A priori standard deviation of the shift of each image; by default 100 px with GCPs, else
        ERR_BIAS of the RPC, the published accuracy of the sensor, or 7 m on the ground (unit px; at
        least 1e-09).
    sigma_drift : float, optional
        A priori standard deviation of the attitude drift of an image; by default 1e-3 with GCPs, else
        1e-4; for models without drift the published value of the sensor, at least 3e-5; 0: no drift
        (unit px/px; at least 0).
    jitter : str, optional
        Remove jitter (vibration of the attitude) along the lines of each image: auto where residuals
        show significant waves, none, or LINES between the knots of the curves (default none).
    threads : int, optional
        Number of threads; 0 takes all cores (at least 0; default 0).
    hold_out : float, optional
        Share of the tie points that the adjustment does not use and that check its result, in blocks
        with more than 500; 0 uses all (at least 0; at most 0.5; default 0.1).
    output_dir : path, optional
        Directory for the results; created where missing.
    overwrite : bool, optional
        Replace the results of an earlier run in the output directory (default no).
    write : str, optional
        Target of the refined RPCs: copies of the images, copies resampled without jitter, the images
        themselves (write-rpc with restore restores the original), virtual images, _RPC.TXT files, or
        none; for an RPC file without image a new _RPC.TXT is written (one of copy, resampled, in-place,
        vrt, sidecar, none; default copy).
    force_write : bool, optional
        Write the refined RPCs even if the verdict is unusable (default no).
    residual_crs : str, optional
        Coordinate systems of the residual layers (one of both, wgs84, utm; default both).
    report : bool, optional
        Write report.html (default yes).
    title : str, optional
        Title of the project, for the cover of report.html.
    client : str, optional
        Client or recipient, for the cover of report.html.
    place : str, optional
        Name of the place, for the cover of report.html.
    stac : bool, optional
        Also write a STAC item of each refined image (ID_stac.json), and one file of all items
        (stac.json) (default no).
    progress : callable, optional
        Called with a fraction and a message; False cancels.

    Returns
    -------
    Result
        The report, its tables and files. Without ``output_dir`` they go when the result does.

    Raises
    ------
    HrsiError
        What is wrong with the input, and what to do about it.
    """
    ...

def refine(
    images: Images,
    *,
    gcps: Points | None = None,
    image_points: Points | None = None,
    gcp_ids: str | Iterable[str] | None = None,
    check_ids: str | Iterable[str] | None = None,
    ground_crs: str | None = None,
    height_datum: str = "layer",
    gcp_epoch: float | None = None,
    strict_datum: bool = False,
    sigma_image: float = 0.5,
    sigma_gcp_xy: float = 0.2,
    sigma_gcp_h: float = 0.3,
    dem: RasterSource | None = None,
    dem_datum: str | None = None,
    model: Literal[
        "auto",
        "generic",
        "none",
        "shift",
        "shift-drift",
        "conformal",
        "affine",
        "quadratic",
        "ground-linear",
        "ground-quadratic",
        "object-shift",
        "object-scale-shift",
        "object-affine",
        "generic-position",
        "generic-shift",
        "generic-12",
        "generic-affine",
        "generic-full",
        "direct",
        "bils",
        "idkf",
        "pg",
        "upoe",
        "slss",
    ] = "auto",
    leave_out: bool = True,
    compare: bool = False,
    coefficient_covariance: Path | None = None,
    output_dir: Path | None = None,
    overwrite: bool = False,
    write: Literal["copy", "resampled", "in-place", "vrt", "sidecar", "none"] = "copy",
    force_write: bool = False,
    residual_crs: Literal["both", "wgs84", "utm"] = "both",
    report: bool = True,
    title: str | None = None,
    client: str | None = None,
    place: str | None = None,
    stac: bool = False,
    threads: int = 0,
    progress: Progress | None = None,
) -> Result:
    """Refined RPCs of single images from ground control points.

    Corrects the RPC of each image separately, from the GCPs measured in it. auto chooses the model with
    the smallest leave-one-out error of the GCPs, and rejects GCPs that contradict the others; generic
    corrects position and attitude of a pseudo sensor. Writes refined RPCs, residual layers and a
    report; ``compare`` adds a table of all models with the same GCPs and check points.

    Parameters
    ----------
    images : path or Image or sequence of them
        Images with RPC, RPC files alone (_RPC.TXT, .RPB, XML, .geom), or STAC items (.json).
    gcps : path or table or array or GroundPoints or ImagePoints, optional
        Ground points with known position: a vector layer or CSV; FILE|columns=id=NAME,… if its fields
        have other names.
    image_points : path or table or array or GroundPoints or ImagePoints, optional
        Image measurements of the points; ground positions in this file are not used.
    gcp_ids : sequence of str, optional
        Ids of the GCPs; all other points with known position are check points.
    check_ids : sequence of str, optional
        Ids of the check points; with ``gcp_ids`` too, all other points with known position are not
        used.
    ground_crs : str, optional
        CRS of ground points whose file does not name one (EPSG:code or WKT).
    height_datum : str, optional
        Height datum of ground points and DEM: layer (from their CRS), ellipsoidal, egm96, egm2008 or
        the file of a geoid grid (default layer).
    gcp_epoch : float, optional
        Year of the images (2015.4), for the plate motion between WGS84 and the datum of points and DEM
        (ETRS89, GDA2020, NAD83); by default the two are treated as equal, and the error is included in
        the accuracy (at least 1957).
    strict_datum : bool, optional
        Stop if the geoid or the grid of a better coordinate operation is not installed, instead of
        using the next best one (default no).
    sigma_image : float, optional
        Standard deviation of image points without one in their file (unit px; at least 1e-06; default
        0.5).
    sigma_gcp_xy : float, optional
        Standard deviation of each horizontal coordinate of GCPs without one in their file (unit m; at
        least 1e-06; default 0.2).
    sigma_gcp_h : float, optional
        Standard deviation of the heights of GCPs without one in their file (unit m; at least 1e-06;
        default 0.3).
    dem : path or rasterio dataset, optional
        DEM of the ground, in any CRS.
    dem_datum : str, optional
        Height datum of the DEM, if it differs from ``height_datum``.
    model : str, optional
        Correction model of the RPCs (one of auto, generic, none, shift, shift-drift, conformal, affine,
        quadratic, ground-linear, ground-quadratic, object-shift, object-scale-shift, object-affine,
        generic-position, generic-shift, generic-12, generic-affine, generic-full, direct, bils, idkf,
        pg, upoe, slss; default auto).
    leave_out : bool, optional
        Reject GCPs that contradict the others; they are listed in any case (default yes).
    compare : bool, optional
        Add a table of all models with the same GCPs and check points (default no).
    coefficient_covariance : path, optional
        Covariance matrix of the normalised coefficients of the RPC, for the direct methods: a text file
        of 78 lines with 78 numbers, sample numerator, sample denominator, line numerator, line
        denominator.
    output_dir : path, optional
        Directory for the results; created where missing.
    overwrite : bool, optional
        Replace the results of an earlier run in the output directory (default no).
    write : str, optional
        Target of the refined RPCs: copies of the images, copies resampled without jitter, the images
        themselves (write-rpc with restore restores the original), virtual images, _RPC.TXT files, or
        none; for an RPC file without image a new _RPC.TXT is written (one of copy, resampled, in-place,
        vrt, sidecar, none; default copy).
    force_write : bool, optional
        Write the refined RPCs even if the verdict is unusable (default no).
    residual_crs : str, optional
        Coordinate systems of the residual layers (one of both, wgs84, utm; default both).
    report : bool, optional
        Write report.html (default yes).
    title : str, optional
        Title of the project, for the cover of report.html.
    client : str, optional
        Client or recipient, for the cover of report.html.
    place : str, optional
        Name of the place, for the cover of report.html.
    stac : bool, optional
        Also write a STAC item of each refined image (ID_stac.json), and one file of all items
        (stac.json) (default no).
    threads : int, optional
        Number of threads; 0 takes all cores (at least 0; default 0).
    progress : callable, optional
        Called with a fraction and a message; False cancels.

    Returns
    -------
    Result
        The report, its tables and files. Without ``output_dir`` they go when the result does.

    Raises
    ------
    HrsiError
        What is wrong with the input, and what to do about it.
    """
    ...

def tie_points(
    images: Images,
    *,
    add_to: str | None = None,
    dem: RasterSource | None = None,
    dem_datum: str | None = None,
    height: float | None = None,
    height_datum: str = "layer",
    strict_datum: bool = False,
    search_margin: float = 128.0,
    cells: int = 12,
    per_cell: int = 0,
    dense: bool = False,
    partners: int = 8,
    min_overlap: float = 0.02,
    matches: Points | None = None,
    scheduler: str | None = None,
    scheduler_ca: Path | None = None,
    scheduler_certificate: Path | None = None,
    scheduler_key: Path | None = None,
    work_dir: str | None = None,
    threads: int = 0,
    csv: bool = False,
    output_dir: Path | None = None,
    overwrite: bool = False,
    progress: Progress | None = None,
) -> Result:
    """Automatic tie points of a block.

    Finds points that are visible in two or more images of a block. Overlaps are computed at the height
    of the ground, from a DEM or from the images themselves, and the errors of the RPCs are estimated at
    a low resolution. Windows of every image are then matched with all images that show them, with sub-
    pixel accuracy and a standard deviation of each position. Points are spread evenly. Images of any
    size are read by windows. Pairs and windows are independent parts, processed by threads of this
    machine or by workers of a Dask scheduler. Finished parts are kept, so that the same command
    continues a run that was stopped.

    The result is the input tie points of adjust and triangulate. Sample 0, line 0 is the CENTRE of the
    first pixel.

    Parameters
    ----------
    images : path or Image or sequence of them
        Images with RPC.
    add_to : str, optional
        Output directory of an earlier search, to which the images are added: its tie points are kept,
        and only pairs with new images are matched.
    dem : path or rasterio dataset, optional
        DEM of the ground, in any CRS.
    dem_datum : str, optional
        Height datum of the DEM, if it differs from ``height_datum``.
    height : float, optional
        Ellipsoidal height of the ground, instead of a DEM (unit m).
    height_datum : str, optional
        Height datum of ground points and DEM: layer (from their CRS), ellipsoidal, egm96, egm2008 or
        the file of a geoid grid (default layer).
    strict_datum : bool, optional
        Stop if the geoid or the grid of a better coordinate operation is not installed, instead of
        using the next best one (default no).
    search_margin : float, optional
        Largest error of the RPCs in the search for tie points; it is increased where nothing is found
        (unit px; at least 0; default 128).
    cells : int, optional
        Every image is divided into N x N cells, over which tie points are spread evenly (at least 1; at
        most 1000; default 12).
    per_cell : int, optional
        Tie points of a cell; 0 takes 40 for images up to 2048 px, which are matched everywhere, else 2
        from a small window in the cell (at least 0; default 0).
    dense : bool, optional
        Match all of every image, with small windows first, and keep all tie points, for a terrain model
        from them (terrain points of orthorectify); takes about 15 s of one core per megapixel of a pair
        (default no).
    partners : int, optional
        Average number of images that each image is matched with: all that overlap if these are few,
        else those with the best test matches, in spanning trees of the block (at least 1; default 8).
    min_overlap : float, optional
        Smallest overlap of two images that are matched, as a share of the image (at least 0; at most 1;
        default 0.02).
    matches : path or table or array or GroundPoints or ImagePoints, optional
        Matches of another program instead of a search: .h5 of hloc, a COLMAP database, matches as text;
        each is measured again by least-squares matching and tested like matches of HRSI.
    scheduler : str, optional
        Address of a Dask scheduler whose workers find tie points or make orthoimages (they need the
        files under the same paths); by default threads of this machine are used. The block adjustment
        itself always runs in this process.
    scheduler_ca : path, optional
        Certificates (PEM) of the authority of a scheduler at tls://HOST:PORT; this and the next two
        default to the Dask configuration (distributed.comm.tls).
    scheduler_certificate : path, optional
        Client certificate (PEM) for a scheduler at tls://HOST:PORT.
    scheduler_key : path, optional
        Private key (PEM) of the client certificate, if it is not in the same file.
    work_dir : str, optional
        Directory for finished parts, which later runs use again; by default a folder in the output
        directory, which is removed at the end of a run.
    threads : int, optional
        Number of threads; 0 takes all cores (at least 0; default 0).
    csv : bool, optional
        Also write the measurements as CSV (default no).
    output_dir : path, optional
        Directory for the results; created where missing.
    overwrite : bool, optional
        Replace the results of an earlier run in the output directory (default no).
    progress : callable, optional
        Called with a fraction and a message; False cancels.

    Returns
    -------
    Result
        The report, its tables and files. Without ``output_dir`` they go when the result does.

    Raises
    ------
    HrsiError
        What is wrong with the input, and what to do about it.
    """
    ...

def gcps_from_reference(
    images: Images,
    reference: RasterSource,
    dem: RasterSource,
    *,
    reference_sigma: float | None = None,
    reference_band: int | None = None,
    reference_points: int = 300,
    reference_search: float = 1024.0,
    threads: int = 0,
    dem_datum: str | None = None,
    height_datum: str = "layer",
    strict_datum: bool = False,
    sigma_dem: float | None = None,
    output_dir: Path | None = None,
    overwrite: bool = False,
    progress: Progress | None = None,
) -> Result:
    """GCPs by matching raw images to a reference orthoimage and DEM.

    Finds textured windows of an orthoimage in raw images with sub-pixel accuracy: RPC and DEM predict
    the content of each image, and matching measures its position. The RPCs may have errors of hundreds
    of pixels; the orthoimage may be of another season or sensor and coarser than the images. Matches
    that contradict the common bias of the image are rejected. The GCPs have the position of the
    orthoimage and the ellipsoidal height of the DEM. Errors of an orthoimage are correlated over large
    areas. The sigmas are therefore chosen so that all points together have the weight of their common
    error, 0.8 of the sigma of the reference. A warning is given if the reference differs from the RPCs
    by more than ERR_BIAS and its sigma allow.

    The layer gcps is an input of adjust and triangulate; triangulate with ``reference`` does both in
    one run.

    Parameters
    ----------
    images : path or Image or sequence of them
        Images with RPC and pixels.
    reference : path or rasterio dataset
        Orthoimage in which GCPs are found by matching, in any CRS.
    dem : path or rasterio dataset
        DEM of the ground, in any CRS.
    reference_sigma : float, optional
        Standard deviation of each horizontal coordinate of the reference; by default twice its pixel
        size, at most 5 m or half a pixel (unit m; at least 1e-06).
    reference_band : int, optional
        Band of the reference; by default the mean of all (at least 1).
    reference_points : int, optional
        Windows of the reference that are searched in each image (at least 12; default 300).
    reference_search : float, optional
        Largest error of the RPCs against the reference (search distance) (unit px; at least 16; default
        1024).
    threads : int, optional
        Number of threads; 0 takes all cores (at least 0; default 0).
    dem_datum : str, optional
        Height datum of the DEM, if it differs from ``height_datum``.
    height_datum : str, optional
        Height datum of ground points and DEM: layer (from their CRS), ellipsoidal, egm96, egm2008 or
        the file of a geoid grid (default layer).
    strict_datum : bool, optional
        Stop if the geoid or the grid of a better coordinate operation is not installed, instead of
        using the next best one (default no).
    sigma_dem : float, optional
        Standard deviation of the heights of the DEM; by default from its cell size (unit m; at least
        1e-06).
    output_dir : path, optional
        Directory for the results; created where missing.
    overwrite : bool, optional
        Replace the results of an earlier run in the output directory (default no).
    progress : callable, optional
        Called with a fraction and a message; False cancels.

    Returns
    -------
    Result
        The report, its tables and files. Without ``output_dir`` they go when the result does.

    Raises
    ------
    HrsiError
        What is wrong with the input, and what to do about it.
    """
    ...

def measure_targets(
    images: Images = (),
    *,
    points: Points | None = None,
    edges: Points | None = None,
    kind: Literal["auto", "center", "corner"] = "auto",
    search: float = 15.0,
    smallest: float = 5.0,
    largest: float = 80.0,
    ground_crs: str | None = None,
    height_datum: str = "layer",
    output_dir: Path | None = None,
    overwrite: bool = False,
    report: bool = True,
    threads: int = 0,
    progress: Progress | None = None,
) -> Result:
    """Sub-pixel centre or corner near given positions, or from edge points measured by hand.

    Measures targets near approximate positions. A centre is that of an ellipse or rectangle through the
    sub-pixel edge points of a closed object. A corner is the intersection of two straight edges, with
    at least three edge points each. Outlying edge points are rejected, and every point has a standard
    deviation. A point is refused if there is no such object; an object that does not cover the position
    must have a clear edge. Positions are read from a point file with sample and line, or projected from
    ground points with the RPCs of the images.

    ``edges`` needs no pixels: the edge points of a file (id, image, sample, line) are used, at least
    six around an ellipse, or three on each of two lines. The report shows a chip of every target.

    Parameters
    ----------
    images : path or Image or sequence of them, optional
        Images; not needed with ``edges``.
    points : path or table or array or GroundPoints or ImagePoints, optional
        Approximate positions, on images or on the ground.
    edges : path or table or array or GroundPoints or ImagePoints, optional
        Edge points measured by hand; those of one target have one id.
    kind : str, optional
        Kind of targets; auto uses the field kind, or centres without it (one of auto, center, corner;
        default auto).
    search : float, optional
        The target lies within this distance (unit px; at least 1; default 15).
    smallest : float, optional
        Smallest diameter of a centre's object (unit px; at least 4; default 5).
    largest : float, optional
        Largest diameter (unit px; at least 8; at most 512; default 80).
    ground_crs : str, optional
        CRS of ground points whose file does not name one (EPSG:code or WKT).
    height_datum : str, optional
        Height datum of ground points and DEM: layer (from their CRS), ellipsoidal, egm96, egm2008 or
        the file of a geoid grid (default layer).
    output_dir : path, optional
        Directory for the results; created where missing.
    overwrite : bool, optional
        Replace the results of an earlier run in the output directory (default no).
    report : bool, optional
        Write report.html with a chip of every target (default yes).
    threads : int, optional
        Number of threads; 0 takes all cores (at least 0; default 0).
    progress : callable, optional
        Called with a fraction and a message; False cancels.

    Returns
    -------
    Result
        The report, its tables and files. Without ``output_dir`` they go when the result does.

    Raises
    ------
    HrsiError
        What is wrong with the input, and what to do about it.
    """
    ...

def evaluate(
    images: Images,
    *,
    rpcs: Mapping[str, Path] | Iterable[str] = (),
    tracks: Points = "auto",
    used_points: Points | None = None,
    apart: float = 10.0,
    reject: float = 6.0,
    gcps: Points | None = None,
    image_points: Points | None = None,
    gcp_ids: str | Iterable[str] | None = None,
    check_ids: str | Iterable[str] | None = None,
    ground_crs: str | None = None,
    height_datum: str = "layer",
    gcp_epoch: float | None = None,
    strict_datum: bool = False,
    sigma_image: float = 0.5,
    sigma_gcp_xy: float = 0.2,
    sigma_gcp_h: float = 0.3,
    dem: RasterSource | None = None,
    dem_datum: str | None = None,
    surface: Points | None = None,
    surface_datum: str | None = None,
    sigma_surface: float | None = None,
    surface_search: float = 100.0,
    surface_kind: Literal["dsm", "dtm"] = "dsm",
    search_margin: float = 128.0,
    cells: int = 12,
    per_cell: int = 0,
    dense: bool = False,
    partners: int = 8,
    min_overlap: float = 0.02,
    matches: Points | None = None,
    scheduler: str | None = None,
    scheduler_ca: Path | None = None,
    scheduler_certificate: Path | None = None,
    scheduler_key: Path | None = None,
    work_dir: str | None = None,
    threads: int = 0,
    output_dir: Path | None = None,
    overwrite: bool = False,
    report: bool = True,
    progress: Progress | None = None,
) -> Result:
    """Accuracy of one or more sets of RPCs with tracks, ground points and a DEM.

    Compares sets of RPCs with the same points: those of the images, refined ones, those of another
    program (``rpcs`` NAME=DIR, once for each set). Nothing is adjusted.

    Each track is predicted in each of its images from the intersection of the other images (strict
    leave-one-out, from three images on). It is also intersected from all images, and compared pair by
    pair across the epipolar lines. A match is rejected only if it is an outlier for all sets. Ground
    points with known position are compared in pixels and metres, separately for GCPs and check points,
    and heights of the tracks with a DEM. With ``surface`` the tracks are matched with its relief, which
    gives the displacement of each set in plan and height.

    The tracks should be independent of the RPCs: give points that the adjustment did not use, or name
    the used ones with ``used_points``.

    Parameters
    ----------
    images : path or Image or sequence of them
        Images with RPC, RPC files alone (_RPC.TXT, .RPB, XML, .geom), or STAC items (.json).
    rpcs : dict of str to path, optional
        A further set of RPCs: its name, and the directory with an RPC or an image with RPC for each
        image, under the name of the image; repeat for each set. The RPCs of the images themselves are
        the set 'own'.
    tracks : path or table or array or GroundPoints or ImagePoints, optional
        Points measured in two or more images: auto finds them in the images, none uses none, FILE reads
        them (default auto).
    used_points : path or table or array or GroundPoints or ImagePoints, optional
        Image points that the adjustment of these RPCs used (block.gpkg): tracks near one of them are
        not evaluated.
    apart : float, optional
        Smallest distance of a track from ``used_points``, on each of its images (unit px; at least 0;
        default 10).
    reject : float, optional
        Reject tracks whose residual exceeds this multiple of sigma for every set of RPCs, as wrong
        matches; 0 rejects none (unit sigma; at least 0; default 6).
    gcps : path or table or array or GroundPoints or ImagePoints, optional
        Ground points with known position: a vector layer or CSV; FILE|columns=id=NAME,… if its fields
        have other names.
    image_points : path or table or array or GroundPoints or ImagePoints, optional
        Image measurements of the points; ground positions in this file are not used.
    gcp_ids : sequence of str, optional
        Ids of the GCPs; all other points with known position are check points.
    check_ids : sequence of str, optional
        Ids of the check points; with ``gcp_ids`` too, all other points with known position are not
        used.
    ground_crs : str, optional
        CRS of ground points whose file does not name one (EPSG:code or WKT).
    height_datum : str, optional
        Height datum of ground points and DEM: layer (from their CRS), ellipsoidal, egm96, egm2008 or
        the file of a geoid grid (default layer).
    gcp_epoch : float, optional
        Year of the images (2015.4), for the plate motion between WGS84 and the datum of points and DEM
        (ETRS89, GDA2020, NAD83); by default the two are treated as equal, and the error is included in
        the accuracy (at least 1957).
    strict_datum : bool, optional
        Stop if the geoid or the grid of a better coordinate operation is not installed, instead of
        using the next best one (default no).
    sigma_image : float, optional
        Standard deviation of image points without one in their file (unit px; at least 1e-06; default
        0.5).
    sigma_gcp_xy : float, optional
        Standard deviation of each horizontal coordinate of GCPs without one in their file (unit m; at
        least 1e-06; default 0.2).
    sigma_gcp_h : float, optional
        Standard deviation of the heights of GCPs without one in their file (unit m; at least 1e-06;
        default 0.3).
    dem : path or rasterio dataset, optional
        DEM of the ground, in any CRS.
    dem_datum : str, optional
        Height datum of the DEM, if it differs from ``height_datum``.
    surface : path or table or array or GroundPoints or ImagePoints, optional
        Surface that constrains the block in plan and height by its relief, instead of ``dem`` with
        sigma dem m: a raster, a lidar point cloud (LAS, LAZ), a layer of points with heights, a granule
        of ICESat-2 or GEDI.
    surface_datum : str, optional
        Height datum of the surface, if it differs from ``height_datum``.
    sigma_surface : float, optional
        Standard deviation of the heights of the surface, four fifths of it common to all heights; by
        default a value for its cell size (unit m; at least 1e-06).
    surface_search : float, optional
        Search distance in plan for the relief of a surface that constrains a block without GCPs; 0: the
        surface constrains heights only (unit m; at least 0; default 100).
    surface_kind : str, optional
        Whether the heights of the DEM or surface include trees and buildings (dsm) or not (dtm) (one of
        dsm, dtm; default dsm).
    search_margin : float, optional
        Largest error of the RPCs in the search for tie points; it is increased where nothing is found
        (unit px; at least 0; default 128).
    cells : int, optional
        Every image is divided into N x N cells, over which tie points are spread evenly (at least 1; at
        most 1000; default 12).
    per_cell : int, optional
        Tie points of a cell; 0 takes 40 for images up to 2048 px, which are matched everywhere, else 2
        from a small window in the cell (at least 0; default 0).
    dense : bool, optional
        Match all of every image, with small windows first, and keep all tie points, for a terrain model
        from them (terrain points of orthorectify); takes about 15 s of one core per megapixel of a pair
        (default no).
    partners : int, optional
        Average number of images that each image is matched with: all that overlap if these are few,
        else those with the best test matches, in spanning trees of the block (at least 1; default 8).
    min_overlap : float, optional
        Smallest overlap of two images that are matched, as a share of the image (at least 0; at most 1;
        default 0.02).
    matches : path or table or array or GroundPoints or ImagePoints, optional
        Matches of another program instead of a search: .h5 of hloc, a COLMAP database, matches as text;
        each is measured again by least-squares matching and tested like matches of HRSI.
    scheduler : str, optional
        Address of a Dask scheduler whose workers find tie points or make orthoimages (they need the
        files under the same paths); by default threads of this machine are used. The block adjustment
        itself always runs in this process.
    scheduler_ca : path, optional
        Certificates (PEM) of the authority of a scheduler at tls://HOST:PORT; this and the next two
        default to the Dask configuration (distributed.comm.tls).
    scheduler_certificate : path, optional
        Client certificate (PEM) for a scheduler at tls://HOST:PORT.
    scheduler_key : path, optional
        Private key (PEM) of the client certificate, if it is not in the same file.
    work_dir : str, optional
        Directory for finished parts, which later runs use again; by default a folder in the output
        directory, which is removed at the end of a run.
    threads : int, optional
        Number of threads; 0 takes all cores (at least 0; default 0).
    output_dir : path, optional
        Directory for the results; created where missing.
    overwrite : bool, optional
        Replace the results of an earlier run in the output directory (default no).
    report : bool, optional
        Write report.html (default yes).
    progress : callable, optional
        Called with a fraction and a message; False cancels.

    Returns
    -------
    Result
        The report, its tables and files. Without ``output_dir`` they go when the result does.

    Raises
    ------
    HrsiError
        What is wrong with the input, and what to do about it.
    """
    ...

def write_rpc(
    images: Images,
    *,
    rpc: Path | None = None,
    write: Literal["copy", "in-place", "vrt", "sidecar", "rpb", "xml", "geom", "json"] = "copy",
    restore: bool = False,
    output_dir: Path | None = None,
    overwrite: bool = False,
    threads: int = 0,
    progress: Progress | None = None,
) -> Result:
    """Write an RPC into a GeoTIFF, a sidecar or a VRT; `restore` restores the original.

    Writes the RPC of any file that HRSI reads (or that of the image) for one or more images. copy
    writes a GeoTIFF with the pixels, compression and overviews of the image; in-place changes the image
    itself and keeps its original RPC in it, so that ``restore`` restores it exactly; vrt writes a
    virtual image; sidecar, rpb, xml, geom and json write a _RPC.TXT, .RPB, ISD XML (ASP), .geom (Orfeo
    ToolBox) or rpcm JSON file. Such a file is written into the folder of the image, or into the output
    directory. docs/how-to/bridges.md lists the formats that other programs read. Everything is read
    again and compared; an existing file is replaced in one step.

    Parameters
    ----------
    images : path or Image or sequence of them
        Images, or RPC files alone (then ``write`` cannot be copy or vrt).
    rpc : path, optional
        File with the RPC to write, or a folder of RPC files with the names of the images; default: the
        RPC of the image.
    write : str, optional
        Target of the RPC (one of copy, in-place, vrt, sidecar, rpb, xml, geom, json; default copy).
    restore : bool, optional
        Restore the original RPC that was replaced in place (default no).
    output_dir : path, optional
        Directory for copies, VRTs and sidecars; created if missing.
    overwrite : bool, optional
        Replace files of an earlier run (default no).
    threads : int, optional
        Number of threads; 0 takes all cores (at least 0; default 0).
    progress : callable, optional
        Called with a fraction and a message; False cancels.

    Returns
    -------
    Result
        The report, its tables and files. Without ``output_dir`` they go when the result does.

    Raises
    ------
    HrsiError
        What is wrong with the input, and what to do about it.
    """
    ...

def crop(
    images: Images,
    *,
    window: str | None = None,
    extent: str | None = None,
    factor: float | None = None,
    resampling: Literal["cubic", "near", "bilinear", "cubicspline", "lanczos"] = "cubic",
    dem: RasterSource | None = None,
    dem_datum: str | None = None,
    height: float | None = None,
    height_datum: str = "layer",
    strict_datum: bool = False,
    format: Literal["gtiff", "cog", "vrt"] = "gtiff",
    compression: Literal["deflate", "lzw", "zstd", "none"] = "deflate",
    output_dir: Path | None = None,
    overwrite: bool = False,
    threads: int = 0,
    progress: Progress | None = None,
) -> Result:
    """Window, overview or resampled copy of images, with the exact RPC.

    Cuts a window out of an image, or resamples the image or window to another pixel size, and writes
    the RPC of the new pixels. It is the same camera, exactly, at any factor; the RPC of gdal_translate
    has an error of half the increase of the pixel size. The metadata of a refinement and the original
    RPC are kept, so that restore of write-rpc works. ``extent`` gives the window as a box on the
    ground, with ``dem`` or ``height``. Bands, data type, masks, nodata and metadata are kept. The files
    are named ID_crop; for an RPC file alone a _RPC.TXT is written.

    Parameters
    ----------
    images : path or Image or sequence of them
        Images with RPC, RPC files alone (_RPC.TXT, .RPB, XML, .geom), or STAC items (.json).
    window : str, optional
        Window to cut; the first pixel is 0, 0.
    extent : str, optional
        Box on the ground, in degrees or in the CRS in brackets after it: the smallest window that
        contains it is cut, within the image.
    factor : float, optional
        Size of the result relative to the window or image: 0.5 halves the number of samples and lines.
        Both are rounded to whole pixels, and the RPC is scaled accordingly (at least 0.001; at most
        64).
    resampling : str, optional
        GDAL's resampling kernel; only with ``factor`` (one of cubic, near, bilinear, cubicspline,
        lanczos; default cubic).
    dem : path or rasterio dataset, optional
        DEM of the ground, in any CRS.
    dem_datum : str, optional
        Height datum of the DEM, if it differs from ``height_datum``.
    height : float, optional
        Ellipsoidal height of the ground, instead of a DEM (unit m).
    height_datum : str, optional
        Height datum of ground points and DEM: layer (from their CRS), ellipsoidal, egm96, egm2008 or
        the file of a geoid grid (default layer).
    strict_datum : bool, optional
        Stop if the geoid or the grid of a better coordinate operation is not installed, instead of
        using the next best one (default no).
    format : str, optional
        A tiled GeoTIFF, a cloud-optimised one with overviews, or a virtual image that reads the
        original (one of gtiff, cog, vrt; default gtiff).
    compression : str, optional
        Compression, all of them lossless (one of deflate, lzw, zstd, none; default deflate).
    output_dir : path, optional
        Directory for the results; created where missing.
    overwrite : bool, optional
        Replace the results of an earlier run in the output directory (default no).
    threads : int, optional
        Number of threads; 0 takes all cores (at least 0; default 0).
    progress : callable, optional
        Called with a fraction and a message; False cancels.

    Returns
    -------
    Result
        The report, its tables and files. Without ``output_dir`` they go when the result does.

    Raises
    ------
    HrsiError
        What is wrong with the input, and what to do about it.
    """
    ...

def strip(
    images: Images,
    *,
    id: str | None = None,
    format: Literal["gtiff", "cog", "vrt"] = "vrt",
    compression: Literal["deflate", "lzw", "zstd", "none"] = "deflate",
    output_dir: Path | None = None,
    overwrite: bool = False,
    threads: int = 0,
    progress: Progress | None = None,
) -> Result:
    """One image with one RPC from the parts or tiles of a strip.

    Joins the parts of a strip as delivered (P001, P002 … of WorldView) or the tiles of a scene (R1C1 …)
    to one image with one RPC. The image is a virtual one by default. The positions of the parts follow
    from the product or from their RPCs; in an overlap the later part is on top. Tiles with a common RPC
    keep it exactly. Otherwise one RPC is fitted to all, and the report gives the difference from each
    part. If it exceeds 0.1 px, a warning is given and the grid of the fit is written as a table.
    Refined parts give a refined strip. RPC files of known image size (ISD, DIMAP) give a _RPC.TXT of
    the strip.

    Parameters
    ----------
    images : path or Image or sequence of them
        Parts of one strip, or tiles of one scene; RPC files alone give the RPC only.
    id : str, optional
        Id of the strip, used as file name; by default that of the first part with _strip.
    format : str, optional
        A virtual image that reads the parts, a tiled GeoTIFF, or a cloud-optimised one with overviews
        (one of gtiff, cog, vrt; default vrt).
    compression : str, optional
        Compression, all of them lossless (one of deflate, lzw, zstd, none; default deflate).
    output_dir : path, optional
        Directory for the results; created where missing.
    overwrite : bool, optional
        Replace the results of an earlier run in the output directory (default no).
    threads : int, optional
        Number of threads; 0 takes all cores (at least 0; default 0).
    progress : callable, optional
        Called with a fraction and a message; False cancels.

    Returns
    -------
    Result
        The report, its tables and files. Without ``output_dir`` they go when the result does.

    Raises
    ------
    HrsiError
        What is wrong with the input, and what to do about it.
    """
    ...

def hand_over(
    result: Path,
    *,
    to: Literal["cars", "s2p", "asp", "micmac", "colmap", "nerf", "points"] = "cars",
    extent: str | None = None,
    dem: RasterSource | None = None,
    dem_datum: str | None = None,
    height_datum: str = "layer",
    most_pairs: int = 8,
    factor: float = 1.0,
    link: bool = False,
    output_dir: Path | None = None,
    overwrite: bool = False,
    threads: int = 0,
    progress: Progress | None = None,
) -> Result:
    """A project folder for another program from an adjusted block, ready to run.

    Writes a folder in which the target program runs with one printed command. It contains the images
    with their refined RPCs, the chosen stereo pairs, an initial DEM of ellipsoidal heights, the
    configuration of the program, and the expected accuracy. Pairs are chosen by convergence angle, sun,
    season and the share of common tie points. The initial DEM (not for CARS) is ``dem``, or a surface
    through the adjusted points.

    Parameters
    ----------
    result : path
        Output directory of an adjustment.
    to : str, optional
        Target program; colmap has perspective cameras, nerf radiance fields with RPCs, points is for
        point clouds and GCPs (one of cars, s2p, asp, micmac, colmap, nerf, points; default cars).
    extent : str, optional
        Box on the ground, in degrees or in the CRS in brackets after it; by default the common area of
        the chosen pairs.
    dem : path or rasterio dataset, optional
        DEM of the ground, in any CRS.
    dem_datum : str, optional
        Height datum of the DEM, if it differs from ``height_datum``.
    height_datum : str, optional
        Height datum of ground points and DEM: layer (from their CRS), ellipsoidal, egm96, egm2008 or
        the file of a geoid grid (default layer).
    most_pairs : int, optional
        Largest number of stereo pairs; the best ones are chosen (at least 1; default 8).
    factor : float, optional
        Size of the crops for colmap and nerf relative to the images (at least 0.001; at most 64;
        default 1).
    link : bool, optional
        Write VRTs that refer to the images instead of copies (default no).
    output_dir : path, optional
        Directory for the results; created where missing.
    overwrite : bool, optional
        Replace the results of an earlier run in the output directory (default no).
    threads : int, optional
        Number of threads; 0 takes all cores (at least 0; default 0).
    progress : callable, optional
        Called with a fraction and a message; False cancels.

    Returns
    -------
    Result
        The report, its tables and files. Without ``output_dir`` they go when the result does.

    Raises
    ------
    HrsiError
        What is wrong with the input, and what to do about it.
    """
    ...

def rpc_info(
    images: Images,
    *,
    dem: RasterSource | None = None,
    dem_datum: str | None = None,
    height: float | None = None,
    height_datum: str = "layer",
    strict_datum: bool = False,
    crs: str | None = None,
    output_dir: Path | None = None,
    overwrite: bool = False,
    threads: int = 0,
    progress: Progress | None = None,
) -> Result:
    """Footprint, GSD, incidence and azimuth, convergence and B/H of pairs, overlaps, check of the RPCs.

    Reports footprint, GSD along line and sample, incidence angle and azimuth of each image. The
    incidence angle is measured at the ground, from the vertical to the ray to the satellite; the
    azimuth from the target to the satellite, clockwise from north. For each pair it reports the
    convergence angle, B/H (distance of the two rays at unit height above the ground) and the overlap on
    the terrain. The overlap depends on the height of the terrain: give a DEM or a height. Warnings are
    given for RPCs that are damaged, exchanged, used outside their height range, or of another image.

    Parameters
    ----------
    images : path or Image or sequence of them
        Images with RPC, RPC files alone (_RPC.TXT, .RPB, XML, .geom), or STAC items (.json).
    dem : path or rasterio dataset, optional
        DEM of the ground, in any CRS.
    dem_datum : str, optional
        Height datum of the DEM, if it differs from ``height_datum``.
    height : float, optional
        Ellipsoidal height of the ground, instead of a DEM (unit m).
    height_datum : str, optional
        Height datum of ground points and DEM: layer (from their CRS), ellipsoidal, egm96, egm2008 or
        the file of a geoid grid (default layer).
    strict_datum : bool, optional
        Stop if the geoid or the grid of a better coordinate operation is not installed, instead of
        using the next best one (default no).
    crs : str, optional
        List the coordinate operations between this CRS and WGS84 in the area of the images: the one
        that is used, and those whose grid is missing (EPSG:code or WKT).
    output_dir : path, optional
        Directory for report and layers; by default the result is only printed.
    overwrite : bool, optional
        Replace the results of an earlier run in the output directory (default no).
    threads : int, optional
        Number of threads; 0 takes all cores (at least 0; default 0).
    progress : callable, optional
        Called with a fraction and a message; False cancels.

    Returns
    -------
    Result
        The report, its tables and files. Without ``output_dir`` they go when the result does.

    Raises
    ------
    HrsiError
        What is wrong with the input, and what to do about it.
    """
    ...

@overload
def project(
    images: Images,
    points: np.ndarray | Sequence[Sequence[float]] | Sequence[float],
    *,
    dem: RasterSource | None = None,
    dem_datum: str | None = None,
    height: float | None = None,
    height_datum: str = "layer",
) -> np.ndarray:
    """Ground points to image coordinates. Array ``(n, …)`` lon, lat, height; returns ``(n, …)`` sample, line."""
    ...

@overload
def project(
    images: Images,
    *,
    points: TableOrFile,
    ground_crs: str | None = None,
    dem: RasterSource | None = None,
    dem_datum: str | None = None,
    height: float | None = None,
    height_datum: str = "layer",
    strict_datum: bool = False,
    output_dir: Path | None = None,
    overwrite: bool = False,
    threads: int = 0,
    progress: Progress | None = None,
) -> Result:
    """Ground points to image coordinates, for a point file or as a filter.

    Computes the positions of ground points in one or more images. Points are read from a vector layer
    or CSV, or as lines 'lon lat height' from standard input. They are WGS84 degrees and ellipsoidal
    metres, or x, y and height of ``ground_crs`` and ``height_datum``. In this case lines 'sample line'
    are printed, with the rest of the input line. Sample 0, line 0 is the CENTRE of the first pixel
    (pixel and line of GDAL are 0.5 larger). For points without a height, the DEM or ``height`` is used.

    Parameters
    ----------
    images : path or Image or sequence of them
        Images with RPC, or RPC files alone.
    points : path or table or array or GroundPoints or ImagePoints, optional
        Ground points: a vector layer or CSV; by default lines on standard input.
    ground_crs : str, optional
        CRS of ground points whose file does not name one (EPSG:code or WKT).
    dem : path or rasterio dataset, optional
        DEM of the ground, in any CRS.
    dem_datum : str, optional
        Height datum of the DEM, if it differs from ``height_datum``.
    height : float, optional
        Ellipsoidal height of the ground, instead of a DEM (unit m).
    height_datum : str, optional
        Height datum of ground points and DEM: layer (from their CRS), ellipsoidal, egm96, egm2008 or
        the file of a geoid grid (default layer).
    strict_datum : bool, optional
        Stop if the geoid or the grid of a better coordinate operation is not installed, instead of
        using the next best one (default no).
    output_dir : path, optional
        Directory for report and layers; by default the result is only printed.
    overwrite : bool, optional
        Replace the results of an earlier run in the output directory (default no).
    threads : int, optional
        Number of threads; 0 takes all cores (at least 0; default 0).
    progress : callable, optional
        Called with a fraction and a message; False cancels.

    Returns
    -------
    Result
        The report, its tables and files. Without ``output_dir`` they go when the result does.

    Raises
    ------
    HrsiError
        What is wrong with the input, and what to do about it.
    """
    ...

@overload
def localize(
    images: Images,
    points: np.ndarray | Sequence[Sequence[float]] | Sequence[float],
    *,
    dem: RasterSource | None = None,
    dem_datum: str | None = None,
    height: float | None = None,
    height_datum: str = "layer",
) -> np.ndarray:
    """Image points to the ground. Array ``(n, …)`` sample, line, height; returns ``(n, …)`` lon, lat, height."""
    ...

@overload
def localize(
    images: Images,
    *,
    points: TableOrFile,
    dem: RasterSource | None = None,
    dem_datum: str | None = None,
    height: float | None = None,
    height_datum: str = "layer",
    strict_datum: bool = False,
    output_dir: Path | None = None,
    overwrite: bool = False,
    threads: int = 0,
    progress: Progress | None = None,
) -> Result:
    """Image points to the ground, at a height or on a DEM, for a point file or as a filter.

    Intersects the rays of image points with the ground. Points are read from a vector layer or CSV with
    the fields sample and line (and image, if there are several), or as lines 'sample line [height]'
    from standard input. In this case lines 'lon lat height' (WGS84 degrees, ellipsoidal metres) are
    printed, with the rest of the input line, and 'nan' for points without a ground position. The
    ellipsoidal height of a point takes precedence over the DEM and ``height``. On a DEM the first
    intersection of the ray from above is used. Sample 0, line 0 is the CENTRE of the first pixel (pixel
    and line of GDAL are 0.5 larger).

    Parameters
    ----------
    images : path or Image or sequence of them
        Images with RPC, or RPC files alone.
    points : path or table or array or GroundPoints or ImagePoints, optional
        Image points: a vector layer or CSV; by default lines on standard input.
    dem : path or rasterio dataset, optional
        DEM of the ground, in any CRS.
    dem_datum : str, optional
        Height datum of the DEM, if it differs from ``height_datum``.
    height : float, optional
        Ellipsoidal height of the ground, instead of a DEM (unit m).
    height_datum : str, optional
        Height datum of ground points and DEM: layer (from their CRS), ellipsoidal, egm96, egm2008 or
        the file of a geoid grid (default layer).
    strict_datum : bool, optional
        Stop if the geoid or the grid of a better coordinate operation is not installed, instead of
        using the next best one (default no).
    output_dir : path, optional
        Directory for report and layers; by default the result is only printed.
    overwrite : bool, optional
        Replace the results of an earlier run in the output directory (default no).
    threads : int, optional
        Number of threads; 0 takes all cores (at least 0; default 0).
    progress : callable, optional
        Called with a fraction and a message; False cancels.

    Returns
    -------
    Result
        The report, its tables and files. Without ``output_dir`` they go when the result does.

    Raises
    ------
    HrsiError
        What is wrong with the input, and what to do about it.
    """
    ...

def fit_rpc(
    points: Points,
    *,
    ground_crs: str | None = None,
    height_datum: str = "layer",
    strict_datum: bool = False,
    id: str | None = None,
    common_denominator: bool = False,
    min_height: float | None = None,
    max_height: float | None = None,
    output_dir: Path | None = None,
    overwrite: bool = False,
    threads: int = 0,
    progress: Progress | None = None,
) -> Result:
    """An RPC from a grid or table of correspondences.

    Fits an RPC to points with known ground position and image coordinates, for example from a grid of a
    sensor model, and writes it as _RPC.TXT. The table has lon, lat, height (or x, y, z with
    ``ground_crs``, or point geometry), sample and line; sample 0, line 0 is the CENTRE of the first
    pixel. For a check, the fit is repeated without every fifth point, and the differences there are
    reported. A full RPC needs at least 45 points, spread over the image and at several heights; with
    fewer points only its lower terms are estimated. ``points`` may also be a file with ephemeris,
    attitude and detectors: the RPC is then fitted to its exact camera, between ``min_height`` and
    ``max_height``, which may be missing for an ISD file that has an RPC. An .adjust file of
    bundle_adjust (ASP 3) moves the RPC of the image that is named behind it; the result is its adjusted
    RPC.

    Parameters
    ----------
    points : path or table or array or GroundPoints or ImagePoints
        Table of correspondences, a CSV or vector layer; or an exact camera: ISD XML with ephemeris and
        attitude, DIMAP V1 of SPOT 5, a CSM state of a line scanner; or RUN.adjust|camera=IMAGE of ASP.
    ground_crs : str, optional
        CRS of ground points whose file does not name one (EPSG:code or WKT).
    height_datum : str, optional
        Height datum of ground points and DEM: layer (from their CRS), ellipsoidal, egm96, egm2008 or
        the file of a geoid grid (default layer).
    strict_datum : bool, optional
        Stop if the geoid or the grid of a better coordinate operation is not installed, instead of
        using the next best one (default no).
    id : str, optional
        Id of the image, used as file name; by default the name of the table.
    common_denominator : bool, optional
        One denominator for sample and line (less accurate, easier to correct later) (default no).
    min_height : float, optional
        Lowest height at which the RPC will be used; exact cameras are sampled from there (unit m).
    max_height : float, optional
        Highest height at which the RPC will be used; a warning is given for extrapolation (unit m).
    output_dir : path, optional
        Directory for the results; created where missing.
    overwrite : bool, optional
        Replace the results of an earlier run in the output directory (default no).
    threads : int, optional
        Number of threads; 0 takes all cores (at least 0; default 0).
    progress : callable, optional
        Called with a fraction and a message; False cancels.

    Returns
    -------
    Result
        The report, its tables and files. Without ``output_dir`` they go when the result does.

    Raises
    ------
    HrsiError
        What is wrong with the input, and what to do about it.
    """
    ...

def surface_model(
    result: Path,
    *,
    resolution: float | None = None,
    crs: str | None = None,
    vertical: str = "ellipsoidal",
    extent: str | None = None,
    reference: RasterSource | None = None,
    reference_datum: str = "layer",
    most_pairs: int = 4,
    tile: int = 512,
    max_sigma: float | None = None,
    dem: RasterSource | None = None,
    dem_datum: str | None = None,
    height_datum: str = "layer",
    compression: Literal["deflate", "lzw", "zstd", "none"] = "deflate",
    scheduler: str | None = None,
    scheduler_ca: Path | None = None,
    scheduler_certificate: Path | None = None,
    scheduler_key: Path | None = None,
    output_dir: Path | None = None,
    overwrite: bool = False,
    report: bool = True,
    threads: int = 0,
    progress: Progress | None = None,
) -> Result:
    """Digital surface model (DSM) of an adjusted block by dense matching.

    Matches the best pairs of an adjusted block at every pixel and intersects the rays of their refined
    RPCs. Pairs are chosen by convergence angle (10 to 25 degrees are best), overlap, sun, season and
    common tie points. The surface model is a cloud-optimised GeoTIFF with three bands: height, its
    standard deviation, and the number of pairs that agree. Where no pair supports a height (water,
    clouds, occlusions, changes between dates) it is nodata. The search starts at the heights of the tie
    points, or of ``dem``. Finished tiles are kept when a run is stopped, and the same command
    continues.

    Parameters
    ----------
    result : path
        Output directory of an adjustment.
    resolution : float, optional
        Cell size, in units of the CRS; by default the finest pixel of the block on the ground, rounded
        (at least 1e-09).
    crs : str, optional
        CRS of the map, projected; by default the UTM zone (or UPS) at the centre of the block.
    vertical : str, optional
        Reference of the heights: ellipsoidal, egm96, egm2008, or a vertical CRS (default ellipsoidal).
    extent : str, optional
        A box in the CRS of the map, or in the CRS in brackets after it; by default the ground that the
        chosen pairs show.
    reference : path or rasterio dataset, optional
        DEM with which the surface is compared: bias, NMAD, LE90, and a raster of the differences.
    reference_datum : str, optional
        Height datum of the reference (default layer).
    most_pairs : int, optional
        Largest number of stereo pairs; the best ones are chosen by convergence, overlap, sun, season
        and common tie points (at least 1; default 4).
    tile : int, optional
        Side of the tiles that are matched together (unit cells; at least 64; at most 2048; default
        512).
    max_sigma : float, optional
        Largest standard deviation of a height; cells with a larger one become nodata. By default all
        are kept (unit m; at least 0.001).
    dem : path or rasterio dataset, optional
        DEM of the ground, in any CRS.
    dem_datum : str, optional
        Height datum of the DEM, if it differs from ``height_datum``.
    height_datum : str, optional
        Height datum of ground points and DEM: layer (from their CRS), ellipsoidal, egm96, egm2008 or
        the file of a geoid grid (default layer).
    compression : str, optional
        Compression, all of them lossless (one of deflate, lzw, zstd, none; default deflate).
    scheduler : str, optional
        Address of a Dask scheduler whose workers find tie points or make orthoimages (they need the
        files under the same paths); by default threads of this machine are used. The block adjustment
        itself always runs in this process.
    scheduler_ca : path, optional
        Certificates (PEM) of the authority of a scheduler at tls://HOST:PORT; this and the next two
        default to the Dask configuration (distributed.comm.tls).
    scheduler_certificate : path, optional
        Client certificate (PEM) for a scheduler at tls://HOST:PORT.
    scheduler_key : path, optional
        Private key (PEM) of the client certificate, if it is not in the same file.
    output_dir : path, optional
        Directory for the results; created where missing.
    overwrite : bool, optional
        Replace the results of an earlier run in the output directory (default no).
    report : bool, optional
        Write report.html (default yes).
    threads : int, optional
        Number of threads; 0 takes all cores (at least 0; default 0).
    progress : callable, optional
        Called with a fraction and a message; False cancels.

    Returns
    -------
    Result
        The report, its tables and files. Without ``output_dir`` they go when the result does.

    Raises
    ------
    HrsiError
        What is wrong with the input, and what to do about it.
    """
    ...

def orthorectify(
    images: Images,
    *,
    dem: RasterSource | None = None,
    dem_datum: str | None = None,
    height: float | None = None,
    height_datum: str = "layer",
    strict_datum: bool = False,
    terrain_points: Points | None = None,
    ground_crs: str | None = None,
    fill_gaps: int = 0,
    visibility: bool = False,
    mosaic: bool = False,
    pansharpen: Path | None = None,
    crs: str | None = None,
    resolution: float | None = None,
    extent: str = "each",
    resampling: Literal[
        "near", "bilinear", "cubic", "cubicspline", "lanczos", "average", "rms", "mode", "max", "min", "med", "q1", "q3"
    ] = "cubic",
    error_px: float = 0.05,
    nodata: str | None = None,
    format: Literal["cog", "gtiff"] = "cog",
    compression: Literal["deflate", "lzw", "zstd", "none"] = "deflate",
    scheduler: str | None = None,
    scheduler_ca: Path | None = None,
    scheduler_certificate: Path | None = None,
    scheduler_key: Path | None = None,
    output_dir: Path | None = None,
    overwrite: bool = False,
    report: bool = True,
    threads: int = 0,
    progress: Progress | None = None,
) -> Result:
    """Orthoimages from (refined) RPCs and a DEM, all on one map grid.

    Makes an orthoimage of every image with the GDAL warper, as cloud-optimised GeoTIFF; all bands, data
    type and nodata are kept. All orthoimages of a block have one pixel grid. Heights of the DEM are
    converted to ellipsoidal heights. Orthoimages of parts of an area have the pixels of that of the
    complete area. The report gives the errors of positions at random pixels. Orthoimages that were made
    from the same files with the same options are kept, so that a stopped run can be continued. With
    ``scheduler`` the tiles are warped by workers of a Dask scheduler, with the same result. Hidden
    ground shows the object in front of it, unless ``visibility`` masks it. ``pansharpen`` combines
    panchromatic and multispectral images. ``mosaic`` makes one image of all, with the areas of the
    images as a layer.

    Parameters
    ----------
    images : path or Image or sequence of them
        Images with RPC.
    dem : path or rasterio dataset, optional
        DEM of the ground, in any CRS.
    dem_datum : str, optional
        Height datum of the DEM, if it differs from ``height_datum``.
    height : float, optional
        Ellipsoidal height of the ground, instead of a DEM (unit m).
    height_datum : str, optional
        Height datum of ground points and DEM: layer (from their CRS), ellipsoidal, egm96, egm2008 or
        the file of a geoid grid (default layer).
    strict_datum : bool, optional
        Stop if the geoid or the grid of a better coordinate operation is not installed, instead of
        using the next best one (default no).
    terrain_points : path or table or array or GroundPoints or ImagePoints, optional
        Points between which the terrain is interpolated where there is no DEM, or where it has gaps:
        the layer ground_points of a triangulation.
    ground_crs : str, optional
        CRS of ground points whose file does not name one (EPSG:code or WKT).
    fill_gaps : int, optional
        Largest width of gaps of the DEM that are interpolated; 0 leaves them nodata (unit cells; at
        least 0; at most 1000; default 0).
    visibility : bool, optional
        Ground that the DEM hides from the sensor becomes nodata (true orthoimages); the DEM is a
        surface model with buildings and trees (default no).
    mosaic : bool, optional
        Also one mosaic of all orthoimages (mosaic.tif) and its seamlines (seamlines.gpkg); ground that
        an image does not show is taken from the others (default no).
    pansharpen : path, optional
        Multispectral image of the exposure of the panchromatic image, or a folder with those of all:
        each pair becomes one pan-sharpened orthoimage; several files are separated by semicolons.
    crs : str, optional
        CRS of the orthoimages; by default the UTM zone at the centre of the block, or UPS beyond 84
        degrees north and 80 south.
    resolution : float, optional
        Pixel size, in units of the CRS (degrees for EPSG:4326); by default the finest pixel of the
        block on the ground, rounded (at least 1e-09).
    extent : str, optional
        each: the area of each image; union or overlap: of all images; or a box in the CRS of the
        orthoimages, or in the CRS in brackets after it. It is enlarged to whole pixels (default each).
    resampling : str, optional
        GDAL's resampling kernel (one of near, bilinear, cubic, cubicspline, lanczos, average, rms,
        mode, max, min, med, q1, q3; default cubic).
    error_px : float, optional
        Largest error of a pixel's position in the image; 0 computes every pixel exactly (unit px; at
        least 0; at most 10; default 0.05).
    nodata : str, optional
        Value of pixels outside the image, or mask for a mask band; by default that of the image, else a
        mask if the image has one, else 0 (NaN for floating point).
    format : str, optional
        Cloud-optimised GeoTIFF with overviews, or a plain tiled GeoTIFF (one of cog, gtiff; default
        cog).
    compression : str, optional
        Compression, all of them lossless (one of deflate, lzw, zstd, none; default deflate).
    scheduler : str, optional
        Address of a Dask scheduler whose workers find tie points or make orthoimages (they need the
        files under the same paths); by default threads of this machine are used. The block adjustment
        itself always runs in this process.
    scheduler_ca : path, optional
        Certificates (PEM) of the authority of a scheduler at tls://HOST:PORT; this and the next two
        default to the Dask configuration (distributed.comm.tls).
    scheduler_certificate : path, optional
        Client certificate (PEM) for a scheduler at tls://HOST:PORT.
    scheduler_key : path, optional
        Private key (PEM) of the client certificate, if it is not in the same file.
    output_dir : path, optional
        Directory for the results; created where missing.
    overwrite : bool, optional
        Replace the results of an earlier run in the output directory (default no).
    report : bool, optional
        Write report.html (default yes).
    threads : int, optional
        Number of threads; 0 takes all cores (at least 0; default 0).
    progress : callable, optional
        Called with a fraction and a message; False cancels.

    Returns
    -------
    Result
        The report, its tables and files. Without ``output_dir`` they go when the result does.

    Raises
    ------
    HrsiError
        What is wrong with the input, and what to do about it.
    """
    ...

def ortho_check(
    images: Images,
    *,
    reference: RasterSource | None = None,
    before: str | None = None,
    window: int = 48,
    search: int = 8,
    min_correlation: float = 0.6,
    most: int = 40,
    output_dir: Path | None = None,
    overwrite: bool = False,
    report: bool = True,
    threads: int = 0,
    progress: Progress | None = None,
) -> Result:
    """Misregistration between overlapping orthoimages, as numbers and arrows.

    Compares all overlapping orthoimages of one map grid with each other, or all with a reference. The
    shift is measured in windows spread over the overlap, to a few hundredths of a pixel, by correlation
    and least squares. It is searched near the common shift of the pair (up to 256 px). The report has
    medians, robust standard deviations and 90th percentiles; the layer shows arrows. ``before`` names
    the folder of the orthoimages made with the original RPCs, which are then measured in the same
    windows.

    Parameters
    ----------
    images : path or Image or sequence of them
        Orthoimages.
    reference : path or rasterio dataset, optional
        Compare all with this orthoimage instead of with each other.
    before : str, optional
        Folder with orthoimages of the same names, from the original RPCs.
    window : int, optional
        Side of a window, even (unit px; at least 16; at most 512; default 48).
    search : int, optional
        Largest difference of the shift of a window from the common shift of the pair (unit px; at least
        1; at most 256; default 8).
    min_correlation : float, optional
        Smallest correlation of windows that are used (at least 0; at most 1; default 0.6).
    most : int, optional
        Windows along the longer side of the common ground (at least 1; at most 1000; default 40).
    output_dir : path, optional
        Directory for the results; created where missing.
    overwrite : bool, optional
        Replace the results of an earlier run in the output directory (default no).
    report : bool, optional
        Write report.html (default yes).
    threads : int, optional
        Number of threads; 0 takes all cores (at least 0; default 0).
    progress : callable, optional
        Called with a fraction and a message; False cancels.

    Returns
    -------
    Result
        The report, its tables and files. Without ``output_dir`` they go when the result does.

    Raises
    ------
    HrsiError
        What is wrong with the input, and what to do about it.
    """
    ...

def init(
    folder: Path = ".",
    *,
    height_datum: str | None = None,
    output: str | None = None,
    overwrite: bool = False,
    threads: int = 0,
    progress: Progress | None = None,
) -> Result:
    """Project file for run from the images, points and DEM of a folder.

    Opens all files of a folder and decides what each is: image, RPC, control or check points,
    measurements, tie points, DEM, laser points, reference orthoimage. Prints a table of the files with
    the reasons, writes a project file with the steps that apply, and checks these steps as a run would.
    A height datum that nothing states is decided by heights of points and rays; otherwise one question
    is asked, which ``height_datum`` answers.

    Parameters
    ----------
    folder : path, optional
        Folder of images, points, DEM and other data, as delivered (default .).
    height_datum : str, optional
        Answer to the question on heights without datum: ellipsoidal, egm96, egm2008 or the file of a
        geoid grid; by default evidence decides.
    output : str, optional
        Project file to be written; by default project.toml in the folder.
    overwrite : bool, optional
        Replace an existing project file (default no).
    threads : int, optional
        Number of threads; 0 takes all cores (at least 0; default 0).
    progress : callable, optional
        Called with a fraction and a message; False cancels.

    Returns
    -------
    Result
        The report, its tables and files.

    Raises
    ------
    HrsiError
        What is wrong with the input, and what to do about it.
    """
    ...

def run(
    project: Path,
    *,
    steps: str | Iterable[str] | None = None,
    output_dir: Path | None = None,
    overwrite: bool = False,
    report: bool = True,
    threads: int = 0,
    progress: Progress | None = None,
) -> Result:
    """All steps of a project: triangulate, surface model, orthorectify, check, evaluate.

    Reads images, points, DEM and the options of each step from a project file and runs the steps in
    order: refined RPCs, surface model, orthoimages, their misregistration, evaluation of the RPCs. Each
    step has a folder in the output directory and a chapter of the report. One image is refined from its
    GCPs alone.

    A stopped run continues. After a finished run only steps with other inputs (by SHA-256) or options
    are repeated.

    Parameters
    ----------
    project : path
        Project file (TOML), or the folder of project.toml.
    steps : sequence of str, optional
        Only these steps, of triangulate, surface-model, orthorectify, ortho-check, evaluate.
    output_dir : path, optional
        Directory for the results, instead of the one that the project names.
    overwrite : bool, optional
        Do all steps again, and replace what else is in the output directory (default no).
    report : bool, optional
        Write report.html, with a chapter for each step (default yes).
    threads : int, optional
        Number of threads; 0 takes all cores (at least 0; default 0).
    progress : callable, optional
        Called with a fraction and a message; False cancels.

    Returns
    -------
    Result
        The report, its tables and files. Without ``output_dir`` they go when the result does.

    Raises
    ------
    HrsiError
        What is wrong with the input, and what to do about it.
    """
    ...

def interest_points(
    images: Images,
    *,
    detector: Literal["harris", "foerstner", "centres", "all"] = "all",
    window: str | None = None,
    band: int = 1,
    sun_azimuth: float | None = None,
    kappa: float = 0.04,
    radius: float = 4.0,
    threshold: float | None = None,
    super_threshold: float | None = None,
    share: float = 0.5,
    super_share: float = 0.07,
    smallest: float = 5.0,
    largest: float = 160.0,
    contrast: float = 0.8,
    quality: float = 0.5,
    per_cell: int = 0,
    cell: float = 256.0,
    mask_saturated: bool = True,
    threads: int = 0,
    dem: RasterSource | None = None,
    dem_datum: str | None = None,
    height: float | None = None,
    height_datum: str = "layer",
    strict_datum: bool = False,
    output_dir: Path | None = None,
    overwrite: bool = False,
    progress: Progress | None = None,
) -> Result:
    """Corners, super points and gravity centres of images as a point layer.

    Finds corners (Harris or Foerstner) and gravity centres of closed bright or dark objects:
    roundabouts, tanks, roofs, pools, ponds, trees, plots, and bright and dark spots with a closed
    outline (blobs). The quality of a centre is the probability that it is found again in another view,
    measured on real pairs of one date: 56 to 76 % for the default. Positions have sub-pixel accuracy,
    with standard deviation, size, orientation and quality. Thresholds follow from the statistics of
    each image in the surroundings of every pixel, so that forest, fields and cities all have points.
    Images of any size are read in overlapping windows; the result does not depend on them. Nodata and
    saturated areas are excluded.

    The position of the sun is read from the delivery (MEANSUNAZ, SUN_AZIMUTH, Sun Angle Azimuth), or
    computed from time and place of the acquisition. The field shadow marks dark centres that are the
    shadow side of an object (yes, no; unknown without an RPC or the sun). On real images 50 to 90 % of
    the marked centres are shadows. In images of one date they are as repeatable as others, so their
    quality is not lower. Between dates with different sun positions they move, and should be excluded
    first.

    For an image with RPC the layer has the ground positions of the points (at its mean height, a given
    height or a DEM). It can be used as image points again. Sample 0, line 0 is the CENTRE of the first
    pixel.

    Parameters
    ----------
    images : path or Image or sequence of them
        Images, with or without RPC.
    detector : str, optional
        Kind of interest points (one of harris, foerstner, centres, all; default all).
    window : str, optional
        Only this window of the image.
    band : int, optional
        Band of the image (at least 1; default 1).
    sun_azimuth : float, optional
        Azimuth of the sun at the acquisition, clockwise from north, if the delivery contains neither it
        nor the time; used to flag dark centres that are shadows (unit deg; at least 0; at most 360).
    kappa : float, optional
        Weight of the trace in Harris's strength (at least 0; at most 0.25; default 0.04).
    radius : float, optional
        Corners are the strongest within this radius (unit px; at least 1; at most 50; default 4).
    threshold : float, optional
        The threshold TB itself.
    super_threshold : float, optional
        The threshold TA itself.
    share : float, optional
        Share of all local maxima that become interest points (sets the threshold TB) (at least 0; at
        most 1; default 0.5).
    super_share : float, optional
        Share of all local maxima that become super points (sets the threshold TA) (at least 0; at most
        1; default 0.07).
    smallest : float, optional
        Smallest diameter of an object with a gravity centre (unit px; at least 4; default 5).
    largest : float, optional
        Largest diameter (unit px; at least 8; at most 512; default 160).
    contrast : float, optional
        Smallest contrast of an object, in standard deviations of its surroundings (at least 0; default
        0.8).
    quality : float, optional
        Smallest quality of a gravity centre: its chance to be found again in a second view, as measured
        on real pairs of one date. Of those from 0.5 two in three have been; 0.33 adds dark spots, of
        which in towns one in three has (at least 0; at most 1; default 0.5).
    per_cell : int, optional
        Keep so many of the best points of each detector in every cell, to spread them; 0 keeps all (at
        least 0; default 0).
    cell : float, optional
        Side of the cells (unit px; at least 8; default 256).
    mask_saturated : bool, optional
        Leave out areas of the largest grey value, where many pixels have it (default yes).
    threads : int, optional
        Number of threads; 0 takes all cores (at least 0; default 0).
    dem : path or rasterio dataset, optional
        DEM of the ground, in any CRS.
    dem_datum : str, optional
        Height datum of the DEM, if it differs from ``height_datum``.
    height : float, optional
        Ellipsoidal height of the ground, instead of a DEM (unit m).
    height_datum : str, optional
        Height datum of ground points and DEM: layer (from their CRS), ellipsoidal, egm96, egm2008 or
        the file of a geoid grid (default layer).
    strict_datum : bool, optional
        Stop if the geoid or the grid of a better coordinate operation is not installed, instead of
        using the next best one (default no).
    output_dir : path, optional
        Directory for the results; created where missing.
    overwrite : bool, optional
        Replace the results of an earlier run in the output directory (default no).
    progress : callable, optional
        Called with a fraction and a message; False cancels.

    Returns
    -------
    Result
        The report, its tables and files. Without ``output_dir`` they go when the result does.

    Raises
    ------
    HrsiError
        What is wrong with the input, and what to do about it.
    """
    ...

def match(
    images: Images,
    *,
    window_1: str | None = None,
    window_2: str | None = None,
    band: int = 1,
    scale: str | float | tuple[float, float] | None = None,
    detector: Literal["harris", "foerstner", "centres", "all"] = "harris",
    radius: float = 3.0,
    share: float = 0.9,
    max_slope: float = 5.0,
    incidence: float = 10.0,
    reach: float = 200.0,
    correlation: float = 0.6,
    consistency: float = 1.5,
    least: int = 12,
    mask_saturated: bool = True,
    threads: int = 0,
    dem: RasterSource | None = None,
    dem_datum: str | None = None,
    height: float | None = None,
    height_datum: str = "layer",
    strict_datum: bool = False,
    output_dir: Path | None = None,
    overwrite: bool = False,
    report: bool = True,
    progress: Progress | None = None,
) -> Result:
    """Corresponding points of two images or windows, without RPC, by control networks.

    Finds hundreds to thousands of corresponding points in two images of the same ground with any
    rotation. The strongest interest points form a network whose shape is searched in the other image.
    All other points are found from its nodes, compared by their grey values and measured with sub-pixel
    accuracy. No RPC is needed. If the network fits in several places, because of repeated texture, the
    status is 'ambiguous'; if it fits nowhere, 'no match'. In both cases there are no correspondences,
    the report gives the reason, and the exit code is 1.

    Windows are read completely: choose them with ``window_1`` and ``window_2`` in large images. Sample
    0, line 0 is the CENTRE of the first pixel.

    Parameters
    ----------
    images : path or Image or sequence of them
        Images, with or without RPC.
    window_1 : str, optional
        Only this window of the first image.
    window_2 : str, optional
        Only this window of the second image.
    band : int, optional
        Band of the images (at least 1; default 1).
    scale : (float, float), optional
        Scale of the second image relative to the first, or the range to search; by default from
        features, else 1 and then 0.6 to 1.7 (at least 0.05; at most 20).
    detector : str, optional
        Interest points to match (one of harris, foerstner, centres, all; default harris).
    radius : float, optional
        Corners are the strongest within this radius; it sets the tolerance too (unit px; at least 1; at
        most 50; default 3).
    share : float, optional
        Share of all local maxima that become interest points (at least 0; at most 1; default 0.9).
    max_slope : float, optional
        Slope of the ground that the tolerance of the networks allows for (unit °; at least 0; at most
        60; default 5).
    incidence : float, optional
        Incidence angle of both images that it allows for (unit °; at least 0; at most 60; default 10).
    reach : float, optional
        Longest distance of a super point from its root (unit px; at least 20; default 200).
    correlation : float, optional
        Smallest correlation of two interest points' surroundings (at least 0; at most 1; default 0.6).
    consistency : float, optional
        Largest difference from the neighbours, beyond their own spread (unit px; at least 0.1; default
        1.5).
    least : int, optional
        Fewer correspondences than these are no match (at least 6; default 12).
    mask_saturated : bool, optional
        Leave out areas of the largest grey value, where many pixels have it (default yes).
    threads : int, optional
        Number of threads; 0 takes all cores (at least 0; default 0).
    dem : path or rasterio dataset, optional
        DEM of the ground, in any CRS.
    dem_datum : str, optional
        Height datum of the DEM, if it differs from ``height_datum``.
    height : float, optional
        Ellipsoidal height of the ground, instead of a DEM (unit m).
    height_datum : str, optional
        Height datum of ground points and DEM: layer (from their CRS), ellipsoidal, egm96, egm2008 or
        the file of a geoid grid (default layer).
    strict_datum : bool, optional
        Stop if the geoid or the grid of a better coordinate operation is not installed, instead of
        using the next best one (default no).
    output_dir : path, optional
        Directory for the results; created where missing.
    overwrite : bool, optional
        Replace the results of an earlier run in the output directory (default no).
    report : bool, optional
        Write report.html with a picture of both windows (default yes).
    progress : callable, optional
        Called with a fraction and a message; False cancels.

    Returns
    -------
    Result
        The report, its tables and files. Without ``output_dir`` they go when the result does.

    Raises
    ------
    HrsiError
        What is wrong with the input, and what to do about it.
    """
    ...

def simulate(
    *,
    sensor: Literal["ikonos", "quickbird", "worldview-2", "pleiades", "spot5", "wide-field"] = "pleiades",
    images: int = 2,
    dates: int = 1,
    off_nadir: float = 20.0,
    size: int = 2000,
    lines: int = 0,
    along: str | Iterable[str] = (),
    across: float = 0.0,
    heading: float = 190.0,
    strips: int = 1,
    places: int = 1,
    overlap: float = 0.2,
    lon: float = 5.45,
    lat: float = 43.53,
    height: float = 250.0,
    landform: Literal["mountains", "hills", "farmland", "city", "flat"] = "farmland",
    relief: float | None = None,
    cliffs: float = 0.0,
    seed: int = 1,
    gcps: int = 10,
    checks: int = 50,
    ties: int = 200,
    noise_image: float = 0.3,
    noise_gcp_xy: float = 0.1,
    noise_gcp_h: float = 0.15,
    blunders: float = 0.0,
    gcp_blunders: float = 0.0,
    blunder_size: float = 30.0,
    wrong_heights: float = 0.0,
    wrong_height_size: float = 25.0,
    vendor_error: float = 1.0,
    vendor_position: str | Iterable[str] = (),
    vendor_position_drift: str | Iterable[str] = (),
    vendor_attitude: str | Iterable[str] = (),
    vendor_attitude_drift: str | Iterable[str] = (),
    jitter: str | Iterable[str] = (),
    jitter_period: float = 2000.0,
    laser_passes: int = 0,
    laser_canopy: float = 0.1,
    laser_segment: float = 40.0,
    laser_clouds: float = 0.03,
    free_dem: float = 0.0,
    free_dem_trees: float = 0.2,
    free_dem_tree_height: float = 10.0,
    free_dem_noise: float = 1.0,
    free_dem_correlation: float = 300.0,
    free_dem_common: float = 2.0,
    free_dem_place: float = 2.8,
    free_ortho: float = 0.0,
    free_ortho_error: float = 5.0,
    free_ortho_corner: float = 0.0,
    free_ortho_change: float = 0.4,
    pixels: bool = True,
    ms: bool = False,
    ortho: bool = False,
    output_dir: Path | None = None,
    overwrite: bool = False,
    threads: int = 0,
    progress: Progress | None = None,
) -> Result:
    """A synthetic block with images, DEM, GCPs, noise and full truth.

    Simulates pushbroom images of a fractal, textured terrain with an exact physical camera. The RPCs
    have errors of orbit and attitude like those of a vendor. Writes images, terrain (ellipsoidal
    heights), ground points, image points and the truth of all of them, to test methods and to plan
    blocks.

    With ``dates`` the images are distributed over a year. Shading and cast shadows follow the sun;
    crops, leaves, ploughed fields and snow follow the season. Buildings have heights, and some are
    built or demolished; there are also cars, haze and gain. truth.gpkg contains all changes with their
    dates.

    With ``laser_passes`` there are passes of a laser altimeter: laser.csv contains its points in the
    format of SlideRule, with the noise and misfits of real ICESat-2 segments, and true_laser.gpkg their
    true surface. ``free_dem`` writes free_dem.tif, a DEM with the errors of Copernicus GLO-30
    (ellipsoidal heights; its displacement is in truth.json). ``free_ortho`` writes free_ortho.tif, an
    orthoimage in four bands of another season with errors of some metres, which are in report.json.

    Parameters
    ----------
    sensor : str, optional
        Sensor of the images (one of ikonos, quickbird, worldview-2, pleiades, spot5, wide-field;
        default pleiades).
    images : int, optional
        Number of images of each place and date (at least 1; at most 50; default 2).
    dates : int, optional
        Number of dates in a year, each with another viewing direction and sun position; 1: all images
        on one day (at least 1; at most 366; default 1).
    off_nadir : float, optional
        Largest off-nadir angle of the views of many dates (unit deg; at least 0; at most 35; default
        20).
    size : int, optional
        Samples of each image, and lines if they are not given (unit px; at least 64; default 2000).
    lines : int, optional
        Lines of each image; 0: equal to the samples (unit px; at least 0; default 0).
    along : sequence of str, optional
        Off-nadir angles along the track, one for each image of a place (unit deg).
    across : float, optional
        Off-nadir angle to the right of the track (unit deg; at least -50; at most 50; default 0).
    heading : float, optional
        Azimuth of the flight direction (unit deg; default 190).
    strips : int, optional
        Number of adjacent strips (at least 1; default 1).
    places : int, optional
        Number of scenes along each strip (at least 1; default 1).
    overlap : float, optional
        Overlap of neighbouring scenes, as a share (at least 0; at most 0.9; default 0.2).
    lon : float, optional
        Longitude of the scene's centre (unit deg; default 5.45).
    lat : float, optional
        Latitude of the scene's centre (unit deg; default 43.53).
    height : float, optional
        Mean ellipsoidal height (unit m; default 250).
    landform : str, optional
        Kind of terrain: relief, and whether there are buildings (one of mountains, hills, farmland,
        city, flat; default farmland).
    relief : float, optional
        Range of heights of the relief; by default that of the landform: 1000, 300, 100, 30 and 2 m
        (unit m; at least 0).
    cliffs : float, optional
        Height of cliffs; 0 makes none (unit m; at least 0; default 0).
    seed : int, optional
        The same seed and options give the same block (at least 0; default 1).
    gcps : int, optional
        Number of GCPs, each a disc on the ground (at least 0; default 10).
    checks : int, optional
        Number of check points (at least 0; default 50).
    ties : int, optional
        Number of tie points (at least 0; default 200).
    noise_image : float, optional
        Standard deviation of image coordinates (unit px; at least 0; default 0.3).
    noise_gcp_xy : float, optional
        Standard deviation of each horizontal coordinate of known points (unit m; at least 0; default
        0.1).
    noise_gcp_h : float, optional
        Standard deviation of the height of known points (unit m; at least 0; default 0.15).
    blunders : float, optional
        Share of tie measurements that are gross errors (at least 0; at most 1; default 0).
    gcp_blunders : float, optional
        Share of GCP measurements that are gross errors (at least 0; at most 1; default 0).
    blunder_size : float, optional
        Mean size of gross errors (unit px; at least 0; default 30).
    wrong_heights : float, optional
        Share of GCPs with a wrong height (at least 0; at most 1; default 0).
    wrong_height_size : float, optional
        Size of wrong heights (unit m; at least 0; default 25).
    vendor_error : float, optional
        Errors of the vendor's orbit and attitude, as a multiple of the sensor's usual ones; 0 gives
        exact RPCs (at least 0; default 1).
    vendor_position : sequence of str, optional
        Error of the vendor's position east, north and up, the same for all images, instead of a random
        one (unit m).
    vendor_position_drift : sequence of str, optional
        Error of the vendor's position, its change over the image, the same for all images, instead of a
        random one (unit m).
    vendor_attitude : sequence of str, optional
        Error of the vendor's roll, pitch and yaw, the same for all images, instead of a random one
        (unit rad).
    vendor_attitude_drift : sequence of str, optional
        Error of the vendor's roll, pitch and yaw, their change over the image, the same for all images,
        instead of a random one (unit rad).
    jitter : sequence of str, optional
        Vibration of the attitude, which the RPCs do not include: amplitude in px, period in lines, and
        so on; or a CSV file with the columns line, across and along (px).
    jitter_period : float, optional
        Period of a vibration that ``jitter`` gives none (unit lines; at least 50; default 2000).
    laser_passes : int, optional
        Passes of a laser altimeter over the scene, six beams each (at least 0; default 0).
    laser_canopy : float, optional
        Share of the laser points that met canopy (at least 0; at most 1; default 0.1).
    laser_segment : float, optional
        Length of the segments whose mean height a laser point is (unit m; at least 1; default 40).
    laser_clouds : float, optional
        Share of the laser points that met clouds (at least 0; at most 1; default 0.03).
    free_dem : float, optional
        Cell size of a DEM as free ones are; 0 writes none (unit m; at least 0; default 0).
    free_dem_trees : float, optional
        Share of the free DEM's cells with trees (at least 0; at most 1; default 0.2).
    free_dem_tree_height : float, optional
        Height of the trees in the free DEM (unit m; at least 0; default 10).
    free_dem_noise : float, optional
        Standard deviation of the free DEM's heights on flat ground; three times that on slopes of 40 %
        (unit m; at least 0; default 1).
    free_dem_correlation : float, optional
        Distance at which the correlation of these errors has fallen to 1/e; 0: each cell has its own
        (unit m; at least 0; default 300).
    free_dem_common : float, optional
        Standard deviation of the common height error of the free DEM (GLO-30: 4 m LE90, with the noise)
        (unit m; at least 0; default 2).
    free_dem_place : float, optional
        Standard deviation of each coordinate in plan by which the free DEM is displaced (GLO-30: 6 m
        CE90) (unit m; at least 0; default 2.8).
    free_ortho : float, optional
        Pixel size of an orthoimage as free ones are; 0 writes none (unit m; at least 0; default 0).
    free_ortho_error : float, optional
        Root mean square displacement of the free orthoimage (unit m; at least 0; default 5).
    free_ortho_corner : float, optional
        Displacement of the north-eastern corner of the free orthoimage against the rest of it (unit m;
        at least 0; default 0).
    free_ortho_change : float, optional
        How much of the ground looks different in the free orthoimage, as in another season (at least 0;
        at most 1; default 0.4).
    pixels : bool, optional
        Render the images; otherwise only RPC files are written (default yes).
    ms : bool, optional
        Also render multispectral images with larger pixels (default no).
    ortho : bool, optional
        Write an orthoimage of the scene without errors (default no).
    output_dir : path, optional
        Directory for the results; created where missing.
    overwrite : bool, optional
        Replace the results of an earlier run in the output directory (default no).
    threads : int, optional
        Number of threads; 0 takes all cores (at least 0; default 0).
    progress : callable, optional
        Called with a fraction and a message; False cancels.

    Returns
    -------
    Result
        The report, its tables and files. Without ``output_dir`` they go when the result does.

    Raises
    ------
    HrsiError
        What is wrong with the input, and what to do about it.
    """
    ...

def register(
    image_points: Points,
    images: Images = (),
    *,
    first: str | None = None,
    second: str | None = None,
    model: Literal["shift", "conformal", "affine", "projective", "rpc-shift", "rpc-affine"] = "affine",
    reject: float = 0.0,
    gsd: float | None = None,
    dem: RasterSource | None = None,
    dem_datum: str | None = None,
    height: float | None = None,
    height_datum: str = "layer",
    strict_datum: bool = False,
    output_dir: Path | None = None,
    overwrite: bool = False,
    report: bool = True,
    threads: int = 0,
    progress: Progress | None = None,
) -> Result:
    """Registration of two images from matched points, by kind of point.

    Transforms the points of the first image to the second one, in image space or with the RPCs (on a
    DEM or at a height). It reports the residuals of centres and corners, used separately and together.
    The images can have different resolutions. Residuals are in pixels of the second image, or in metres
    with ``gsd``.

    Parameters
    ----------
    image_points : path or table or array or GroundPoints or ImagePoints
        Points measured in both images.
    images : path or Image or sequence of them, optional
        The two images; needed for the models with RPC only.
    first : str, optional
        Id of the first image; by default the first one.
    second : str, optional
        Id of the second image; by default the next one.
    model : str, optional
        Transformation (one of shift, conformal, affine, projective, rpc-shift, rpc-affine; default
        affine).
    reject : float, optional
        Leave out points beyond this many robust standard deviations; 0 keeps all (unit sigma; at least
        0; default 0).
    gsd : float, optional
        Pixel size of the second image, for residuals in metres (unit m; at least 1e-06).
    dem : path or rasterio dataset, optional
        DEM of the ground, in any CRS.
    dem_datum : str, optional
        Height datum of the DEM, if it differs from ``height_datum``.
    height : float, optional
        Ellipsoidal height of the ground, instead of a DEM (unit m).
    height_datum : str, optional
        Height datum of ground points and DEM: layer (from their CRS), ellipsoidal, egm96, egm2008 or
        the file of a geoid grid (default layer).
    strict_datum : bool, optional
        Stop if the geoid or the grid of a better coordinate operation is not installed, instead of
        using the next best one (default no).
    output_dir : path, optional
        Directory for the results; created where missing.
    overwrite : bool, optional
        Replace the results of an earlier run in the output directory (default no).
    report : bool, optional
        Write report.html (default yes).
    threads : int, optional
        Number of threads; 0 takes all cores (at least 0; default 0).
    progress : callable, optional
        Called with a fraction and a message; False cancels.

    Returns
    -------
    Result
        The report, its tables and files. Without ``output_dir`` they go when the result does.

    Raises
    ------
    HrsiError
        What is wrong with the input, and what to do about it.
    """
    ...

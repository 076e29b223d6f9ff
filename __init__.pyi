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
        A camera to be used instead of the image's own; an RPC, what `read_rpc` returned, or a file.
    id : str, optional
        Name in the block; by default the file's stem without a trailing ``_RPC``.

    Returns
    -------
    Image or list of Image
        With ``rpc``, ``size`` and a way to the pixels; a list for a sequence.

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
    hold_out: float = 0.1,
    output_dir: Path | None = None,
    overwrite: bool = False,
    write: Literal["copy", "in-place", "vrt", "sidecar", "none"] = "copy",
    force_write: bool = False,
    residual_crs: Literal["both", "wgs84", "utm"] = "both",
    report: bool = True,
    title: str | None = None,
    client: str | None = None,
    place: str | None = None,
    stac: bool = False,
    progress: Progress | None = None,
) -> Result:
    """Tie points and GCPs to refined RPCs, residual layers and a report.

    The main job. Finds tie points between overlapping images, takes ground control points from a vector
    layer or CSV, corrects all RPCs in one bundle block adjustment and reports how well the check points
    agree. GCPs may also come from an orthoimage (``reference``, with ``dem``). Without any GCP the
    block is held where its RPCs put it, or where a ``surface`` has its relief, and the images fit one
    another. The refined images are ready for gdalwarp -rpc.

    Parameters
    ----------
    images : path or Image or sequence of them
        Images with RPC, RPC files alone (_RPC.TXT, .RPB, XML, .geom), or STAC items (.json).
    gcps : path or table or array or GroundPoints or ImagePoints, optional
        Ground points with known position: a vector layer or CSV.
    image_points : path or table or array or GroundPoints or ImagePoints, optional
        Where points were measured on the images; ground positions in it are not used.
    gcp_ids : sequence of str, optional
        These points are control, all other known points are check points.
    check_ids : sequence of str, optional
        These points are check points; with ``gcp_ids`` too, all other known points take no part.
    ground_crs : str, optional
        CRS of ground points whose file does not name one (EPSG:code or WKT).
    height_datum : str, optional
        What heights of ground points and DEM refer to: layer (as their CRS says), ellipsoidal, egm96,
        egm2008 or a geoid grid file (default layer).
    gcp_epoch : float, optional
        Year (2015.4) in which points and DEM are brought to WGS84 where their datum moves with a plate
        (ETRS89, GDA2020, NAD83): that of the images; by default such a datum is taken for WGS84, with
        the accuracy of that (at least 1957).
    strict_datum : bool, optional
        Stop where the geoid that is meant or the grid of a better coordinate operation is not
        installed, instead of going on with the next best one (default no).
    sigma_image : float, optional
        Standard deviation of image points whose file gives none (unit px; at least 1e-06; default 0.5).
    sigma_gcp_xy : float, optional
        Standard deviation of each horizontal GCP coordinate whose file gives none (unit m; at least
        1e-06; default 0.2).
    sigma_gcp_h : float, optional
        Standard deviation of GCP heights whose file gives none (unit m; at least 1e-06; default 0.3).
    tie_points : path or table or array or GroundPoints or ImagePoints, optional
        auto finds them in the images, none does without, FILE or a result's folder has them (default
        auto).
    dem : path or rasterio dataset, optional
        DEM of the ground, in any CRS.
    dem_datum : str, optional
        What the heights of the DEM refer to, where it is not what ``height_datum`` says.
    surface : path or table or array or GroundPoints or ImagePoints, optional
        Surface whose relief and heights hold the block in plan and height, instead of ``dem`` with
        ``sigma_dem``: a raster, a lidar cloud (LAS, LAZ), a layer of points with heights, a granule of
        ICESat-2 or GEDI.
    surface_datum : str, optional
        What the heights of the surface refer to, where it is not what ``height_datum`` says.
    sigma_surface : float, optional
        Standard deviation of the heights of the surface, four fifths of it common to all; by default
        what its cell size is known for (unit m; at least 1e-06).
    laser : path or table or array or GroundPoints or ImagePoints, optional
        Laser points whose heights hold the block, without image points: a granule of ICESat-2 (ATL06,
        ATL08) or GEDI L2A, SlideRule's GeoParquet or CSV, or a point layer with height and sigma_h.
    laser_datum : str, optional
        What the heights of laser points in a layer refer to; those of granules are ellipsoidal (default
        ellipsoidal).
    reference : path or rasterio dataset, optional
        Orthoimage in which GCPs are found by matching, in any CRS.
    reference_sigma : float, optional
        Standard deviation of each horizontal coordinate of the reference; by default twice its pixel
        size, at most 5 m or half a pixel (unit m; at least 1e-06).
    reference_band : int, optional
        Band of the reference; by default the mean of all (at least 1).
    reference_points : int, optional
        Places of the reference looked for in each image (at least 12; default 300).
    reference_search : float, optional
        How far the RPCs may be off against the reference (unit px; at least 16; default 1024).
    threads : int, optional
        Number of threads; 0 takes all cores (at least 0; default 0).
    add_to : str, optional
        Output directory of an earlier adjustment, whose block the images join.
    earlier_cameras : str, optional
        What the cameras of the earlier block are: free, adjusted again from all measurements, or
        observed, as the earlier adjustment left them, with all that it says of them together; then its
        points are not used again (one of free, observed; default free).
    search_margin : float, optional
        How far the RPCs may be off when tie points are searched; the search widens where it finds
        nothing (unit px; at least 0; default 128).
    cells : int, optional
        Every image is divided into N x N cells, which are filled evenly with tie points (at least 1; at
        most 1000; default 12).
    per_cell : int, optional
        Tie points of a cell; 0 takes 40 for images up to 2048 px, which are matched everywhere, else 2
        from a small window in the cell (at least 0; default 0).
    dense : bool, optional
        Match all of every image, with small windows first, and keep all tie points: for terrain through
        them (orthorectify's terrain points); some 15 s of one core for a pair's megapixel (default no).
    partners : int, optional
        Match each image with so many others on average: all that overlap where these are few, else
        those that a probe says will match, in spanning trees of the block (at least 1; default 8).
    min_overlap : float, optional
        Share of an image that another must show to be matched (at least 0; at most 1; default 0.02).
    matches : path or table or array or GroundPoints or ImagePoints, optional
        Matches of another program instead of a search: hloc's .h5, a COLMAP database, matches as text;
        each is measured anew by least-squares matching and judged as those found here.
    scheduler : str, optional
        Address of a Dask scheduler whose workers find tie points or make orthoimages (they must see the
        files under the same paths); by default threads of this machine do. A block is always adjusted
        by this process.
    scheduler_ca : path, optional
        Certificates (PEM) of the authority that signed those of a scheduler at tls://HOST:PORT; this
        and the next two are by default as Dask's configuration (distributed.comm.tls) says.
    scheduler_certificate : path, optional
        Certificate (PEM) to show to a scheduler at tls://HOST:PORT.
    scheduler_key : path, optional
        Private key (PEM) of that certificate, where it is not in the same file.
    work_dir : str, optional
        Directory that keeps what is finished, for later runs too; by default a folder in the output
        directory, which a run that was stopped leaves behind, and a finished run removes.
    model : str, optional
        Correction of each image's RPC; auto and generic choose it by GCPs and tie points (one of auto,
        generic, none, shift, shift-drift, conformal, affine, quadratic, ground-linear, ground-
        quadratic, object-shift, object-scale-shift, object-affine, generic-position, generic-shift,
        generic-12, generic-affine, generic-full; default auto).
    robust : str, optional
        Weight function against blunders (one of none, huber, cauchy, tukey; default none).
    reject : float, optional
        Leave out tie measurements and GCPs that fail their test at this many sigmas (data snooping); 0
        keeps all (unit sigma; at least 0; default 4).
    check_as_ties : bool, optional
        Image points of check points take part like tie points (never their survey) (default no).
    test_sigmas : bool, optional
        Test the sigmas of the observations by the residuals and estimate them where they fail, and how
        much the images drift; without, all are as given (default yes).
    variance_components : bool, optional
        Estimate the sigmas of image points by kind and sensor and of GCPs from the residuals, and
        adjust with them (default no).
    variance_groups : str, optional
        What tells groups of image points apart when their sigmas are estimated (one of kind-sensor,
        kind, sensor, image, kind-image; default kind-sensor).
    sensor_images : sequence of sequences of str, optional
        Images of one sensor, whose image points have one sigma; groups joined by +; by default images
        of like resolution.
    cross_validate : bool, optional
        Predict each GCP by an adjustment without it (default no).
    fixed_images : sequence of str, optional
        Reference images, whose RPCs stay as they are.
    shared_images : sequence of sequences of str, optional
        Images of one exposure, strip or orbit that get the same correction; groups joined by +.
    sigma_dem : float, optional
        Standard deviation of the heights of ``dem``, which then hold the tie points; by default they
        hold none (unit m; at least 1e-06).
    surface_search : float, optional
        Largest displacement in plan in which the relief of a surface is looked for that holds a block
        without GCPs; 0: it holds heights only (unit m; at least 0; default 100).
    surface_kind : str, optional
        Whether trees and buildings stand in the heights of the DEM or surface (dsm) or not (dtm) (one
        of dsm, dtm; default dsm).
    laser_reach : float, optional
        How far from a laser point tie points tell the ground's shape, and are held by its height (unit
        m; at least 0.1; default 25).
    sigma_laser : float, optional
        Standard deviation of every laser height beside the one that its file states (unit m; at least
        0; default 0.1).
    sigma_shift : float, optional
        Prior standard deviation of each image's shift; by default 100 px with GCPs, else the RPC's
        ERR_BIAS, what is published of the sensor, or 7 m on the ground (unit px; at least 1e-09).
    sigma_drift : float, optional
        Prior standard deviation of an image's drift; by default 1e-3 with GCPs, else 1e-4; where the
        model does not follow drift, which then is an error, what is believed of the sensor, at least
        3e-5; 0: no drift (unit px/px; at least 0).
    hold_out : float, optional
        Share of the tie tracks that take no part in the adjustment and judge its result, of blocks with
        more than 500; 0 lets all take part (at least 0; at most 0.5; default 0.1).
    output_dir : path, optional
        Directory for the results; created where missing.
    overwrite : bool, optional
        Replace the results of an earlier run in the output directory (default no).
    write : str, optional
        Where refined RPCs go: into copies of the images, into the images themselves (write-rpc with
        restore brings the original back), into virtual images, into _RPC.TXT files, or nowhere; an RPC
        file without image gets a new _RPC.TXT (one of copy, in-place, vrt, sidecar, none; default
        copy).
    force_write : bool, optional
        Write the refined RPCs although the verdict on the result is unusable (default no).
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
        Write a STAC item of each refined image too (ID_stac.json), and all of them in one file
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
    threads: int = 0,
    hold_out: float = 0.1,
    output_dir: Path | None = None,
    overwrite: bool = False,
    write: Literal["copy", "in-place", "vrt", "sidecar", "none"] = "copy",
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

    Corrects the RPCs of all images of a block together, from ground control points, tie points or both,
    and reports how well the check points agree. Writes refined RPCs, residual layers and a report.

    Parameters
    ----------
    images : path or Image or sequence of them
        Images with RPC, RPC files alone (_RPC.TXT, .RPB, XML, .geom), or STAC items (.json).
    gcps : path or table or array or GroundPoints or ImagePoints, optional
        Ground points with known position: a vector layer or CSV.
    image_points : path or table or array or GroundPoints or ImagePoints, optional
        Where points were measured on the images; ground positions in it are not used.
    gcp_ids : sequence of str, optional
        These points are control, all other known points are check points.
    check_ids : sequence of str, optional
        These points are check points; with ``gcp_ids`` too, all other known points take no part.
    ground_crs : str, optional
        CRS of ground points whose file does not name one (EPSG:code or WKT).
    height_datum : str, optional
        What heights of ground points and DEM refer to: layer (as their CRS says), ellipsoidal, egm96,
        egm2008 or a geoid grid file (default layer).
    gcp_epoch : float, optional
        Year (2015.4) in which points and DEM are brought to WGS84 where their datum moves with a plate
        (ETRS89, GDA2020, NAD83): that of the images; by default such a datum is taken for WGS84, with
        the accuracy of that (at least 1957).
    strict_datum : bool, optional
        Stop where the geoid that is meant or the grid of a better coordinate operation is not
        installed, instead of going on with the next best one (default no).
    sigma_image : float, optional
        Standard deviation of image points whose file gives none (unit px; at least 1e-06; default 0.5).
    sigma_gcp_xy : float, optional
        Standard deviation of each horizontal GCP coordinate whose file gives none (unit m; at least
        1e-06; default 0.2).
    sigma_gcp_h : float, optional
        Standard deviation of GCP heights whose file gives none (unit m; at least 1e-06; default 0.3).
    tie_points : path or table or array or GroundPoints or ImagePoints, optional
        FILE of further image points, measured on two or more images, or folder of a result; none does
        without (default none).
    dem : path or rasterio dataset, optional
        DEM of the ground, in any CRS.
    dem_datum : str, optional
        What the heights of the DEM refer to, where it is not what ``height_datum`` says.
    surface : path or table or array or GroundPoints or ImagePoints, optional
        Surface whose relief and heights hold the block in plan and height, instead of ``dem`` with
        ``sigma_dem``: a raster, a lidar cloud (LAS, LAZ), a layer of points with heights, a granule of
        ICESat-2 or GEDI.
    surface_datum : str, optional
        What the heights of the surface refer to, where it is not what ``height_datum`` says.
    sigma_surface : float, optional
        Standard deviation of the heights of the surface, four fifths of it common to all; by default
        what its cell size is known for (unit m; at least 1e-06).
    laser : path or table or array or GroundPoints or ImagePoints, optional
        Laser points whose heights hold the block, without image points: a granule of ICESat-2 (ATL06,
        ATL08) or GEDI L2A, SlideRule's GeoParquet or CSV, or a point layer with height and sigma_h.
    laser_datum : str, optional
        What the heights of laser points in a layer refer to; those of granules are ellipsoidal (default
        ellipsoidal).
    add_to : str, optional
        Output directory of an earlier adjustment, whose block the images join.
    earlier_cameras : str, optional
        What the cameras of the earlier block are: free, adjusted again from all measurements, or
        observed, as the earlier adjustment left them, with all that it says of them together; then its
        points are not used again (one of free, observed; default free).
    model : str, optional
        Correction of each image's RPC; auto and generic choose it by GCPs and tie points (one of auto,
        generic, none, shift, shift-drift, conformal, affine, quadratic, ground-linear, ground-
        quadratic, object-shift, object-scale-shift, object-affine, generic-position, generic-shift,
        generic-12, generic-affine, generic-full; default auto).
    robust : str, optional
        Weight function against blunders (one of none, huber, cauchy, tukey; default none).
    reject : float, optional
        Leave out tie measurements and GCPs that fail their test at this many sigmas (data snooping); 0
        keeps all (unit sigma; at least 0; default 4).
    check_as_ties : bool, optional
        Image points of check points take part like tie points (never their survey) (default no).
    test_sigmas : bool, optional
        Test the sigmas of the observations by the residuals and estimate them where they fail, and how
        much the images drift; without, all are as given (default yes).
    variance_components : bool, optional
        Estimate the sigmas of image points by kind and sensor and of GCPs from the residuals, and
        adjust with them (default no).
    variance_groups : str, optional
        What tells groups of image points apart when their sigmas are estimated (one of kind-sensor,
        kind, sensor, image, kind-image; default kind-sensor).
    sensor_images : sequence of sequences of str, optional
        Images of one sensor, whose image points have one sigma; groups joined by +; by default images
        of like resolution.
    cross_validate : bool, optional
        Predict each GCP by an adjustment without it (default no).
    fixed_images : sequence of str, optional
        Reference images, whose RPCs stay as they are.
    shared_images : sequence of sequences of str, optional
        Images of one exposure, strip or orbit that get the same correction; groups joined by +.
    sigma_dem : float, optional
        Standard deviation of the heights of ``dem``, which then hold the tie points; by default they
        hold none (unit m; at least 1e-06).
    surface_search : float, optional
        Largest displacement in plan in which the relief of a surface is looked for that holds a block
        without GCPs; 0: it holds heights only (unit m; at least 0; default 100).
    surface_kind : str, optional
        Whether trees and buildings stand in the heights of the DEM or surface (dsm) or not (dtm) (one
        of dsm, dtm; default dsm).
    laser_reach : float, optional
        How far from a laser point tie points tell the ground's shape, and are held by its height (unit
        m; at least 0.1; default 25).
    sigma_laser : float, optional
        Standard deviation of every laser height beside the one that its file states (unit m; at least
        0; default 0.1).
    sigma_shift : float, optional
        Prior standard deviation of each image's shift; by default 100 px with GCPs, else the RPC's
        ERR_BIAS, what is published of the sensor, or 7 m on the ground (unit px; at least 1e-09).
    sigma_drift : float, optional
        Prior standard deviation of an image's drift; by default 1e-3 with GCPs, else 1e-4; where the
        model does not follow drift, which then is an error, what is believed of the sensor, at least
        3e-5; 0: no drift (unit px/px; at least 0).
    threads : int, optional
        Number of threads; 0 takes all cores (at least 0; default 0).
    hold_out : float, optional
        Share of the tie tracks that take no part in the adjustment and judge its result, of blocks with
        more than 500; 0 lets all take part (at least 0; at most 0.5; default 0.1).
    output_dir : path, optional
        Directory for the results; created where missing.
    overwrite : bool, optional
        Replace the results of an earlier run in the output directory (default no).
    write : str, optional
        Where refined RPCs go: into copies of the images, into the images themselves (write-rpc with
        restore brings the original back), into virtual images, into _RPC.TXT files, or nowhere; an RPC
        file without image gets a new _RPC.TXT (one of copy, in-place, vrt, sidecar, none; default
        copy).
    force_write : bool, optional
        Write the refined RPCs although the verdict on the result is unusable (default no).
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
        Write a STAC item of each refined image too (ID_stac.json), and all of them in one file
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
    output_dir: Path | None = None,
    overwrite: bool = False,
    write: Literal["copy", "in-place", "vrt", "sidecar", "none"] = "copy",
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

    Corrects the RPC of each image by itself, from the GCPs measured on it. The model auto chooses what
    predicts GCPs best from the others, names GCPs that disagree and leaves them out; generic corrects
    position and attitude of a pseudo sensor. Writes refined RPCs, residual layers and a report;
    ``compare`` adds a table of all models with the same control and check points.

    Parameters
    ----------
    images : path or Image or sequence of them
        Images with RPC, RPC files alone (_RPC.TXT, .RPB, XML, .geom), or STAC items (.json).
    gcps : path or table or array or GroundPoints or ImagePoints, optional
        Ground points with known position: a vector layer or CSV.
    image_points : path or table or array or GroundPoints or ImagePoints, optional
        Where points were measured on the images; ground positions in it are not used.
    gcp_ids : sequence of str, optional
        These points are control, all other known points are check points.
    check_ids : sequence of str, optional
        These points are check points; with ``gcp_ids`` too, all other known points take no part.
    ground_crs : str, optional
        CRS of ground points whose file does not name one (EPSG:code or WKT).
    height_datum : str, optional
        What heights of ground points and DEM refer to: layer (as their CRS says), ellipsoidal, egm96,
        egm2008 or a geoid grid file (default layer).
    gcp_epoch : float, optional
        Year (2015.4) in which points and DEM are brought to WGS84 where their datum moves with a plate
        (ETRS89, GDA2020, NAD83): that of the images; by default such a datum is taken for WGS84, with
        the accuracy of that (at least 1957).
    strict_datum : bool, optional
        Stop where the geoid that is meant or the grid of a better coordinate operation is not
        installed, instead of going on with the next best one (default no).
    sigma_image : float, optional
        Standard deviation of image points whose file gives none (unit px; at least 1e-06; default 0.5).
    sigma_gcp_xy : float, optional
        Standard deviation of each horizontal GCP coordinate whose file gives none (unit m; at least
        1e-06; default 0.2).
    sigma_gcp_h : float, optional
        Standard deviation of GCP heights whose file gives none (unit m; at least 1e-06; default 0.3).
    model : str, optional
        Correction of each image's RPC (one of auto, generic, none, shift, shift-drift, conformal,
        affine, quadratic, ground-linear, ground-quadratic, object-shift, object-scale-shift, object-
        affine, generic-position, generic-shift, generic-12, generic-affine, generic-full, direct, bils,
        idkf, pg, upoe, slss; default auto).
    leave_out : bool, optional
        GCPs that disagree with the others are left out; they are named in any case (default yes).
    compare : bool, optional
        Tabulate all models on the same control and check points (default no).
    output_dir : path, optional
        Directory for the results; created where missing.
    overwrite : bool, optional
        Replace the results of an earlier run in the output directory (default no).
    write : str, optional
        Where refined RPCs go: into copies of the images, into the images themselves (write-rpc with
        restore brings the original back), into virtual images, into _RPC.TXT files, or nowhere; an RPC
        file without image gets a new _RPC.TXT (one of copy, in-place, vrt, sidecar, none; default
        copy).
    force_write : bool, optional
        Write the refined RPCs although the verdict on the result is unusable (default no).
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
        Write a STAC item of each refined image too (ID_stac.json), and all of them in one file
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
    """Automatic tie points over a block.

    Finds points that are on two or more images of a block. Overlaps are found at the true height of the
    ground, from a DEM or from the images themselves; what the RPCs are off is learnt at a low
    resolution; then windows of every image are matched with all images that show them, to a fraction of
    a pixel, with the standard deviation of each position. Points are spread evenly. Images of any size
    are read by windows; pairs and windows are independent parts, done by the threads of this machine or
    the workers of a Dask scheduler. What is finished is kept: the same command continues a run that was
    stopped.

    The result goes into adjust and triangulate as their tie points. Sample 0, line 0 is the CENTRE of
    the first pixel.

    Parameters
    ----------
    images : path or Image or sequence of them
        Images with RPC.
    add_to : str, optional
        Output directory of an earlier search, whose images these join: its tie points are kept, and
        only pairs with new images are matched.
    dem : path or rasterio dataset, optional
        DEM of the ground, in any CRS.
    dem_datum : str, optional
        What the heights of the DEM refer to, where it is not what ``height_datum`` says.
    height : float, optional
        Ellipsoidal height of the ground, instead of a DEM (unit m).
    height_datum : str, optional
        What heights of ground points and DEM refer to: layer (as their CRS says), ellipsoidal, egm96,
        egm2008 or a geoid grid file (default layer).
    strict_datum : bool, optional
        Stop where the geoid that is meant or the grid of a better coordinate operation is not
        installed, instead of going on with the next best one (default no).
    search_margin : float, optional
        How far the RPCs may be off when tie points are searched; the search widens where it finds
        nothing (unit px; at least 0; default 128).
    cells : int, optional
        Every image is divided into N x N cells, which are filled evenly with tie points (at least 1; at
        most 1000; default 12).
    per_cell : int, optional
        Tie points of a cell; 0 takes 40 for images up to 2048 px, which are matched everywhere, else 2
        from a small window in the cell (at least 0; default 0).
    dense : bool, optional
        Match all of every image, with small windows first, and keep all tie points: for terrain through
        them (orthorectify's terrain points); some 15 s of one core for a pair's megapixel (default no).
    partners : int, optional
        Match each image with so many others on average: all that overlap where these are few, else
        those that a probe says will match, in spanning trees of the block (at least 1; default 8).
    min_overlap : float, optional
        Share of an image that another must show to be matched (at least 0; at most 1; default 0.02).
    matches : path or table or array or GroundPoints or ImagePoints, optional
        Matches of another program instead of a search: hloc's .h5, a COLMAP database, matches as text;
        each is measured anew by least-squares matching and judged as those found here.
    scheduler : str, optional
        Address of a Dask scheduler whose workers find tie points or make orthoimages (they must see the
        files under the same paths); by default threads of this machine do. A block is always adjusted
        by this process.
    scheduler_ca : path, optional
        Certificates (PEM) of the authority that signed those of a scheduler at tls://HOST:PORT; this
        and the next two are by default as Dask's configuration (distributed.comm.tls) says.
    scheduler_certificate : path, optional
        Certificate (PEM) to show to a scheduler at tls://HOST:PORT.
    scheduler_key : path, optional
        Private key (PEM) of that certificate, where it is not in the same file.
    work_dir : str, optional
        Directory that keeps what is finished, for later runs too; by default a folder in the output
        directory, which a run that was stopped leaves behind, and a finished run removes.
    threads : int, optional
        Number of threads; 0 takes all cores (at least 0; default 0).
    csv : bool, optional
        Write the measurements as CSV too (default no).
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

    Finds textured places of an orthoimage in raw images, to a fraction of a pixel: RPC and DEM predict
    what each image should show, and matching finds it there. RPCs may be off by hundreds of pixels, the
    orthoimage may be of another season or sensor and coarser than the images. Matches that do not
    follow one bias of the image are left out. The GCPs have their position from the orthoimage, their
    height from the DEM (above the ellipsoid), and sigmas such that all points of the reference together
    count as what they share: 0.8 of its sigma and a little more, because errors of an orthoimage are
    alike over wide areas. A reference that lies farther beside the RPCs than ERR_BIAS and its own sigma
    explain is named.

    The layer gcps is ready for adjust and triangulate; triangulate with its ``reference`` does both in
    one go.

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
        Places of the reference looked for in each image (at least 12; default 300).
    reference_search : float, optional
        How far the RPCs may be off against the reference (unit px; at least 16; default 1024).
    threads : int, optional
        Number of threads; 0 takes all cores (at least 0; default 0).
    dem_datum : str, optional
        What the heights of the DEM refer to, where it is not what ``height_datum`` says.
    height_datum : str, optional
        What heights of ground points and DEM refer to: layer (as their CRS says), ellipsoidal, egm96,
        egm2008 or a geoid grid file (default layer).
    strict_datum : bool, optional
        Stop where the geoid that is meant or the grid of a better coordinate operation is not
        installed, instead of going on with the next best one (default no).
    sigma_dem : float, optional
        Standard deviation of the DEM's heights; by default from the size of its cells (unit m; at least
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
    roundabouts, tanks, roofs, pools, ponds, trees, plots, and of bright and dark spots inside a closed
    outline (blobs). The quality of a centre is its chance to be found again in another view, measured
    on real pairs of one date: of those of the default 56 to 76 in 100 were. Positions are to a fraction
    of a pixel and come with their standard deviation, size, orientation and quality. Thresholds follow
    from each image's own statistics, relative to the surroundings of every pixel, so that forest, field
    and city all deliver points. Images of any size are read in overlapping windows; the result does not
    depend on them. Nodata and saturated areas are left out.

    Where the sun stood is read from the delivery (MEANSUNAZ, SUN_AZIMUTH, Sun Angle Azimuth), else
    follows from the time and place of the acquisition. Then the field shadow says of dark centres
    whether they are the shadow side of something (yes, no; unknown without an RPC or the sun). On real
    images half to nine in ten of those flagged owe it to the sun; they are found again as often as
    others, so their quality is not lower. Across dates with another sun they move, and are the first to
    leave out.

    The layer lies at the points' ground positions where the image has an RPC (at its mean height, a
    given height or a DEM), and it can be used as image points again. Sample 0, line 0 is the CENTRE of
    the first pixel.

    Parameters
    ----------
    images : path or Image or sequence of them
        Images, with or without RPC.
    detector : str, optional
        What to find (one of harris, foerstner, centres, all; default all).
    window : str, optional
        Only this window of the image.
    band : int, optional
        Band of the image (at least 1; default 1).
    sun_azimuth : float, optional
        Azimuth of the sun when the images were taken, clockwise from north, where their deliveries tell
        neither that nor the time: flags dark centres that are shadows (unit deg; at least 0; at most
        360).
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
        What the heights of the DEM refer to, where it is not what ``height_datum`` says.
    height : float, optional
        Ellipsoidal height of the ground, instead of a DEM (unit m).
    height_datum : str, optional
        What heights of ground points and DEM refer to: layer (as their CRS says), ellipsoidal, egm96,
        egm2008 or a geoid grid file (default layer).
    strict_datum : bool, optional
        Stop where the geoid that is meant or the grid of a better coordinate operation is not
        installed, instead of going on with the next best one (default no).
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
    """Corresponding points of two images or windows without RPC, by control networks.

    Finds hundreds to thousands of corresponding points in two images of the same ground, whatever their
    rotation: the strongest interest points form a network whose shape is looked for in the other image;
    all others are found from its nodes, compared by their grey values and measured to a fraction of a
    pixel. No RPC is needed. Where the texture repeats, so that the network fits in several places, the
    status is 'ambiguous'; where it fits nowhere, 'no match'; then there are no correspondences, the
    report says why, and the command ends with exit code 1.

    Windows are read as a whole: choose them with ``window_1`` and ``window_2`` in large images. Sample
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
        Pixels of the second image for one of the first, or the range to search; by default what
        features tell, else 1 and then 0.6 to 1.7 (at least 0.05; at most 20).
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
        What the heights of the DEM refer to, where it is not what ``height_datum`` says.
    height : float, optional
        Ellipsoidal height of the ground, instead of a DEM (unit m).
    height_datum : str, optional
        What heights of ground points and DEM refer to: layer (as their CRS says), ellipsoidal, egm96,
        egm2008 or a geoid grid file (default layer).
    strict_datum : bool, optional
        Stop where the geoid that is meant or the grid of a better coordinate operation is not
        installed, instead of going on with the next best one (default no).
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
    """Sub-pixel centre or corner near given positions, or from hand-measured edge points.

    Measures points that were clicked roughly: the centre of a round or otherwise closed object (an
    ellipse or rectangle through its sub-pixel edge points), or the corner where two straight edges meet
    (a line through three edge points or more each). Stray edge points are left out, every point gets
    its standard deviation, and a point is refused where the feature is not there; an object that does
    not cover the position must be a clear one. Positions come from a point file with sample and line,
    or from ground points that the images' RPCs project.

    With ``edges`` no pixels are needed: the edge points of a file (id, image, sample, line) are
    evaluated, six or more around an ellipse, or three or more on each of two lines. The report shows a
    chip of every target.

    Parameters
    ----------
    images : path or Image or sequence of them, optional
        Images; not needed with ``edges``.
    points : path or table or array or GroundPoints or ImagePoints, optional
        Approximate positions, on images or on the ground.
    edges : path or table or array or GroundPoints or ImagePoints, optional
        Hand-measured edge points, those of a target under one id.
    kind : str, optional
        What the targets are; auto takes the field kind, and centres where there is none (one of auto,
        center, corner; default auto).
    search : float, optional
        The target lies within this distance (unit px; at least 1; default 15).
    smallest : float, optional
        Smallest diameter of a centre's object (unit px; at least 4; default 5).
    largest : float, optional
        Largest diameter (unit px; at least 8; at most 512; default 80).
    ground_crs : str, optional
        CRS of ground points whose file does not name one (EPSG:code or WKT).
    height_datum : str, optional
        What heights of ground points and DEM refer to: layer (as their CRS says), ellipsoidal, egm96,
        egm2008 or a geoid grid file (default layer).
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
    """How well RPCs fit: tracks, ground points, a DEM; several sets side by side.

    Answers whether RPCs are better than others: those of the images as they are, refined ones, another
    tool's (``rpcs`` NAME=DIR, once for each set). All sets are judged by the same points. Nothing is
    adjusted.

    Each track is predicted on each of its images from a ground point that the other images alone
    intersect (strict leave-one-out; three images or more), fitted by all its rays, and taken pair by
    pair across the epipolar lines. Wrong matches are left out only where they fit under no set of RPCs.
    Known ground points, control and check apart, are compared in pixels and metres, heights of the
    tracks with a DEM; with ``surface`` the tracks are matched with its relief, which tells by how much
    each set is displaced in plan and height.

    The RPCs should not have seen the tracks: give points that took no part in the adjustment, or name
    those that did by ``used_points``.

    Parameters
    ----------
    images : path or Image or sequence of them
        Images with RPC, RPC files alone (_RPC.TXT, .RPB, XML, .geom), or STAC items (.json).
    rpcs : dict of str to path, optional
        A further set of RPCs: its name, and the directory that holds an RPC or an image with RPC for
        each image, under the image's name; given again for each set. The images' own RPCs are the set
        'own'.
    tracks : path or table or array or GroundPoints or ImagePoints, optional
        Points on two images or more: auto finds them in the images, none does without, FILE reads them
        (default auto).
    used_points : path or table or array or GroundPoints or ImagePoints, optional
        Image points that an adjustment of these RPCs used (block.gpkg): tracks near one of them take no
        part.
    apart : float, optional
        How far from ``used_points`` a track must be, on each of its images (unit px; at least 0;
        default 10).
    reject : float, optional
        Leave out tracks with a residual of so many sigmas under every set of RPCs: wrong matches; 0
        keeps all (unit sigma; at least 0; default 6).
    gcps : path or table or array or GroundPoints or ImagePoints, optional
        Ground points with known position: a vector layer or CSV.
    image_points : path or table or array or GroundPoints or ImagePoints, optional
        Where points were measured on the images; ground positions in it are not used.
    gcp_ids : sequence of str, optional
        These points are control, all other known points are check points.
    check_ids : sequence of str, optional
        These points are check points; with ``gcp_ids`` too, all other known points take no part.
    ground_crs : str, optional
        CRS of ground points whose file does not name one (EPSG:code or WKT).
    height_datum : str, optional
        What heights of ground points and DEM refer to: layer (as their CRS says), ellipsoidal, egm96,
        egm2008 or a geoid grid file (default layer).
    gcp_epoch : float, optional
        Year (2015.4) in which points and DEM are brought to WGS84 where their datum moves with a plate
        (ETRS89, GDA2020, NAD83): that of the images; by default such a datum is taken for WGS84, with
        the accuracy of that (at least 1957).
    strict_datum : bool, optional
        Stop where the geoid that is meant or the grid of a better coordinate operation is not
        installed, instead of going on with the next best one (default no).
    sigma_image : float, optional
        Standard deviation of image points whose file gives none (unit px; at least 1e-06; default 0.5).
    sigma_gcp_xy : float, optional
        Standard deviation of each horizontal GCP coordinate whose file gives none (unit m; at least
        1e-06; default 0.2).
    sigma_gcp_h : float, optional
        Standard deviation of GCP heights whose file gives none (unit m; at least 1e-06; default 0.3).
    dem : path or rasterio dataset, optional
        DEM of the ground, in any CRS.
    dem_datum : str, optional
        What the heights of the DEM refer to, where it is not what ``height_datum`` says.
    surface : path or table or array or GroundPoints or ImagePoints, optional
        Surface whose relief and heights hold the block in plan and height, instead of ``dem`` with
        sigma dem m: a raster, a lidar cloud (LAS, LAZ), a layer of points with heights, a granule of
        ICESat-2 or GEDI.
    surface_datum : str, optional
        What the heights of the surface refer to, where it is not what ``height_datum`` says.
    sigma_surface : float, optional
        Standard deviation of the heights of the surface, four fifths of it common to all; by default
        what its cell size is known for (unit m; at least 1e-06).
    surface_search : float, optional
        Largest displacement in plan in which the relief of a surface is looked for that holds a block
        without GCPs; 0: it holds heights only (unit m; at least 0; default 100).
    surface_kind : str, optional
        Whether trees and buildings stand in the heights of the DEM or surface (dsm) or not (dtm) (one
        of dsm, dtm; default dsm).
    search_margin : float, optional
        How far the RPCs may be off when tie points are searched; the search widens where it finds
        nothing (unit px; at least 0; default 128).
    cells : int, optional
        Every image is divided into N x N cells, which are filled evenly with tie points (at least 1; at
        most 1000; default 12).
    per_cell : int, optional
        Tie points of a cell; 0 takes 40 for images up to 2048 px, which are matched everywhere, else 2
        from a small window in the cell (at least 0; default 0).
    dense : bool, optional
        Match all of every image, with small windows first, and keep all tie points: for terrain through
        them (orthorectify's terrain points); some 15 s of one core for a pair's megapixel (default no).
    partners : int, optional
        Match each image with so many others on average: all that overlap where these are few, else
        those that a probe says will match, in spanning trees of the block (at least 1; default 8).
    min_overlap : float, optional
        Share of an image that another must show to be matched (at least 0; at most 1; default 0.02).
    matches : path or table or array or GroundPoints or ImagePoints, optional
        Matches of another program instead of a search: hloc's .h5, a COLMAP database, matches as text;
        each is measured anew by least-squares matching and judged as those found here.
    scheduler : str, optional
        Address of a Dask scheduler whose workers find tie points or make orthoimages (they must see the
        files under the same paths); by default threads of this machine do. A block is always adjusted
        by this process.
    scheduler_ca : path, optional
        Certificates (PEM) of the authority that signed those of a scheduler at tls://HOST:PORT; this
        and the next two are by default as Dask's configuration (distributed.comm.tls) says.
    scheduler_certificate : path, optional
        Certificate (PEM) to show to a scheduler at tls://HOST:PORT.
    scheduler_key : path, optional
        Private key (PEM) of that certificate, where it is not in the same file.
    work_dir : str, optional
        Directory that keeps what is finished, for later runs too; by default a folder in the output
        directory, which a run that was stopped leaves behind, and a finished run removes.
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
    """Put an RPC into a GeoTIFF, a sidecar or a VRT; `restore` brings the original back.

    Writes the RPC of any file that HRSI reads (or the image's own, wherever it is kept) for one or more
    images. copy writes a GeoTIFF with the pixels, compression and overviews of the image; in-place
    changes the image itself and keeps its original RPC in it, so that ``restore`` brings it back bit by
    bit; vrt writes a virtual image; sidecar, rpb, xml, geom and json write a _RPC.TXT, .RPB, ISD XML
    (ASP), .geom (Orfeo ToolBox) or rpcm JSON file, beside the image unless an output directory is given
    (docs/bridges.md says who reads what). Everything is read again and compared; a file that exists is
    replaced in one step.

    Parameters
    ----------
    images : path or Image or sequence of them
        Images, or RPC files alone (then ``write`` cannot be copy or vrt).
    rpc : path, optional
        File with the RPC to write, or a folder of RPC files named like the images; default: the image's
        own RPC.
    write : str, optional
        Where the RPC goes (one of copy, in-place, vrt, sidecar, rpb, xml, geom, json; default copy).
    restore : bool, optional
        Bring back the RPC from before the first writing in place (default no).
    output_dir : path, optional
        Directory for copies, VRTs and sidecars; created where missing.
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
    """A window, overview or resampling of images with the exact RPC of its pixels.

    Cuts a window out of an image, or brings the image or window to another pixel size, and gives it the
    RPC of its pixels: the same camera, exactly, at any factor (gdal_translate is off by half of what a
    pixel has grown). The RPC is the one that counts, wherever it is kept; what is told of a refinement
    stays in the file, and its original RPC, which restore of write-rpc brings back. With ``extent`` the
    window follows from the ground: give ``dem`` or ``height`` with it. Bands, data type, masks, nodata
    and metadata are kept. The files are called ID_crop; an RPC file alone becomes a _RPC.TXT.

    Parameters
    ----------
    images : path or Image or sequence of them
        Images with RPC, RPC files alone (_RPC.TXT, .RPB, XML, .geom), or STAC items (.json).
    window : str, optional
        The window to cut, from 0, 0, the first pixel.
    extent : str, optional
        A box on the ground, in degrees or in the CRS that stands in brackets behind it: the window that
        shows all of it is cut, as far as the image reaches.
    factor : float, optional
        Size of the result to that of the window, or of the whole image: 0.5 halves the number of
        samples and lines. Both are rounded to whole pixels, and the RPC follows what comes out (at
        least 0.001; at most 64).
    resampling : str, optional
        GDAL's resampling kernel; only with ``factor`` (one of cubic, near, bilinear, cubicspline,
        lanczos; default cubic).
    dem : path or rasterio dataset, optional
        DEM of the ground, in any CRS.
    dem_datum : str, optional
        What the heights of the DEM refer to, where it is not what ``height_datum`` says.
    height : float, optional
        Ellipsoidal height of the ground, instead of a DEM (unit m).
    height_datum : str, optional
        What heights of ground points and DEM refer to: layer (as their CRS says), ellipsoidal, egm96,
        egm2008 or a geoid grid file (default layer).
    strict_datum : bool, optional
        Stop where the geoid that is meant or the grid of a better coordinate operation is not
        installed, instead of going on with the next best one (default no).
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
    """Parts or tiles of one strip as one image with one RPC.

    Joins the parts in which a strip was delivered (WorldView's P001, P002 …) or the tiles of a scene
    (R1C1 …) to one image, a virtual one unless pixels of its own are asked for, and gives it one RPC.
    Where the parts lie follows from the product or from their RPCs; where they overlap the later one is
    on top. Tiles with one RPC have it exactly; other RPCs are fitted together, and the report states
    how far the fit is from each part. Where that is more than 0.1 px a warning says so, and the grid
    that the RPC was fitted to is written as a table. Refined parts give a refined strip. RPC files
    alone whose size is known (ISD, DIMAP) give the strip's _RPC.TXT.

    Parameters
    ----------
    images : path or Image or sequence of them
        Parts of one strip, or tiles of one scene; RPC files alone give the RPC only.
    id : str, optional
        Id of the strip, which names the files; by default that of the first part and _strip.
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
    """A project for the next program from an adjusted block, ready to run.

    Writes a folder in which the next program runs with one printed command: the images with their
    refined RPCs, the stereo pairs worth matching, an initial DEM of ellipsoidal heights, the program's
    configuration, and the accuracy to expect. Pairs are chosen by convergence, sun, season and the
    share of common tie points; the initial DEM is ``dem``, or a surface through the adjusted points.

    Parameters
    ----------
    result : path
        Output directory of an adjustment.
    to : str, optional
        The next program; colmap gets perspective cameras, nerf is for radiance fields with RPCs, points
        for point clouds and GCPs (one of cars, s2p, asp, micmac, colmap, nerf, points; default cars).
    extent : str, optional
        Region of interest: a box on the ground, in degrees or in the CRS that stands in brackets behind
        it; by default all that the chosen pairs have in common.
    dem : path or rasterio dataset, optional
        DEM of the ground, in any CRS.
    dem_datum : str, optional
        What the heights of the DEM refer to, where it is not what ``height_datum`` says.
    height_datum : str, optional
        What heights of ground points and DEM refer to: layer (as their CRS says), ellipsoidal, egm96,
        egm2008 or a geoid grid file (default layer).
    most_pairs : int, optional
        Most stereo pairs, the best first (at least 1; default 8).
    factor : float, optional
        Size of the crops for colmap and nerf to that of the images (at least 0.001; at most 64; default
        1).
    link : bool, optional
        Refer to the images by VRTs instead of copying them (default no).
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
    """Footprint, GSD, incidence and azimuth, pair convergence and B/H, overlaps, RPC sanity.

    Says for each image where it lies, the ground size of a pixel along line and sample, the incidence
    angle (at the ground, between the ray to the satellite and the vertical) and the azimuth (from the
    target to the satellite, clockwise from north); and for each pair the convergence angle, B/H
    (distance of the two rays at unit height above the ground) and which share of each image the other
    one sees on the terrain. Overlap depends on the terrain's height: give a DEM or a height. Warns of
    RPCs that are damaged, swapped, used beyond their heights, or of another image.

    Parameters
    ----------
    images : path or Image or sequence of them
        Images with RPC, RPC files alone (_RPC.TXT, .RPB, XML, .geom), or STAC items (.json).
    dem : path or rasterio dataset, optional
        DEM of the ground, in any CRS.
    dem_datum : str, optional
        What the heights of the DEM refer to, where it is not what ``height_datum`` says.
    height : float, optional
        Ellipsoidal height of the ground, instead of a DEM (unit m).
    height_datum : str, optional
        What heights of ground points and DEM refer to: layer (as their CRS says), ellipsoidal, egm96,
        egm2008 or a geoid grid file (default layer).
    strict_datum : bool, optional
        Stop where the geoid that is meant or the grid of a better coordinate operation is not
        installed, instead of going on with the next best one (default no).
    crs : str, optional
        List the coordinate operations between this CRS and WGS84 at the images' place: which one is
        taken, and which lack their grid (EPSG:code or WKT).
    output_dir : path, optional
        Directory for report and layers; without it the result is only printed.
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

    Computes where ground points lie in one or more images. Points come from a vector layer or CSV, or
    as lines 'lon lat height' (WGS84 degrees, ellipsoidal metres) on standard input; then lines 'sample
    line' are printed, with what follows the coordinates. Sample 0, line 0 is the CENTRE of the first
    pixel (GDAL's pixel and line are 0.5 larger). Points without a height take it from the DEM or from
    ``height``.

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
        What the heights of the DEM refer to, where it is not what ``height_datum`` says.
    height : float, optional
        Ellipsoidal height of the ground, instead of a DEM (unit m).
    height_datum : str, optional
        What heights of ground points and DEM refer to: layer (as their CRS says), ellipsoidal, egm96,
        egm2008 or a geoid grid file (default layer).
    strict_datum : bool, optional
        Stop where the geoid that is meant or the grid of a better coordinate operation is not
        installed, instead of going on with the next best one (default no).
    output_dir : path, optional
        Directory for report and layers; without it the result is only printed.
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

    Follows the rays of image points to the ground. Points come from a vector layer or CSV with the
    fields sample and line (and image, where several are given), or as lines 'sample line [height]' on
    standard input; then lines 'lon lat height' (WGS84 degrees, ellipsoidal metres) are printed, with
    what follows the coordinates, and 'nan' where there is no ground position. A point's own ellipsoidal
    height counts before the DEM and ``height``. On a DEM the first hit of the ray from above counts.
    Sample 0, line 0 is the CENTRE of the first pixel (GDAL's pixel and line are 0.5 larger).

    Parameters
    ----------
    images : path or Image or sequence of them
        Images with RPC, or RPC files alone.
    points : path or table or array or GroundPoints or ImagePoints, optional
        Image points: a vector layer or CSV; by default lines on standard input.
    dem : path or rasterio dataset, optional
        DEM of the ground, in any CRS.
    dem_datum : str, optional
        What the heights of the DEM refer to, where it is not what ``height_datum`` says.
    height : float, optional
        Ellipsoidal height of the ground, instead of a DEM (unit m).
    height_datum : str, optional
        What heights of ground points and DEM refer to: layer (as their CRS says), ellipsoidal, egm96,
        egm2008 or a geoid grid file (default layer).
    strict_datum : bool, optional
        Stop where the geoid that is meant or the grid of a better coordinate operation is not
        installed, instead of going on with the next best one (default no).
    output_dir : path, optional
        Directory for report and layers; without it the result is only printed.
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

    Fits an RPC to points with known ground position and image coordinates, as a sensor model or another
    program computes them on a grid, and writes it as _RPC.TXT. The table has lon, lat, height (or x, y,
    z with ``ground_crs``, or point geometry), sample and line; sample 0, line 0 is the CENTRE of the
    first pixel. One point in five is left out once, and the differences there are reported. A full RPC
    takes 45 points or more, spread over the image and at several heights; with fewer points only its
    lower terms are estimated.

    Parameters
    ----------
    points : path or table or array or GroundPoints or ImagePoints
        Table of correspondences: a CSV or vector layer.
    ground_crs : str, optional
        CRS of ground points whose file does not name one (EPSG:code or WKT).
    height_datum : str, optional
        What heights of ground points and DEM refer to: layer (as their CRS says), ellipsoidal, egm96,
        egm2008 or a geoid grid file (default layer).
    strict_datum : bool, optional
        Stop where the geoid that is meant or the grid of a better coordinate operation is not
        installed, instead of going on with the next best one (default no).
    id : str, optional
        Id of the image, which names the file; by default the stem of the table.
    common_denominator : bool, optional
        One denominator for sample and line (less exact, simpler to correct later) (default no).
    min_height : float, optional
        Lowest height where the RPC will be used; warns where it extrapolates (unit m).
    max_height : float, optional
        Highest height where the RPC will be used; warns where it extrapolates (unit m).
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

    Makes an orthoimage of every image with GDAL's warper: all bands, data type and nodata kept, as
    cloud-optimised GeoTIFF. All pixels lie on one lattice, so that the orthoimages of a block register
    pixel to pixel. Heights of the DEM are brought to the ellipsoid. Positions are right to
    ``error_px``; the report states what was found at random pixels. Orthoimages that were made before
    from the same files with the same options are kept, so a stopped run goes on where it was. With
    ``scheduler`` the tiles are warped by the workers of a Dask scheduler and written here, the same
    bytes. Ground hidden from the sensor shows what hides it.

    Parameters
    ----------
    images : path or Image or sequence of them
        Images with RPC.
    dem : path or rasterio dataset, optional
        DEM of the ground, in any CRS.
    dem_datum : str, optional
        What the heights of the DEM refer to, where it is not what ``height_datum`` says.
    height : float, optional
        Ellipsoidal height of the ground, instead of a DEM (unit m).
    height_datum : str, optional
        What heights of ground points and DEM refer to: layer (as their CRS says), ellipsoidal, egm96,
        egm2008 or a geoid grid file (default layer).
    strict_datum : bool, optional
        Stop where the geoid that is meant or the grid of a better coordinate operation is not
        installed, instead of going on with the next best one (default no).
    terrain_points : path or table or array or GroundPoints or ImagePoints, optional
        Points whose heights make the terrain, instead of a DEM: the layer ground_points of a
        triangulation.
    ground_crs : str, optional
        CRS of ground points whose file does not name one (EPSG:code or WKT).
    fill_gaps : int, optional
        Interpolate gaps of the DEM up to so many of its cells wide; 0 leaves them nodata (unit cells;
        at least 0; at most 1000; default 0).
    crs : str, optional
        CRS of the orthoimages; by default the UTM zone of the block's middle, or UPS beyond 84 degrees
        north and 80 south.
    resolution : float, optional
        Pixel size, in units of the CRS (degrees for EPSG:4326); by default the finest pixel of the
        block on the ground, rounded (at least 1e-09).
    extent : str, optional
        each: what the image shows; union or overlap: of all images; or a box in the CRS of the
        orthoimages, or in the one that stands in brackets behind it. Widened to whole pixels (default
        each).
    resampling : str, optional
        GDAL's resampling kernel (one of near, bilinear, cubic, cubicspline, lanczos, average, rms,
        mode, max, min, med, q1, q3; default cubic).
    error_px : float, optional
        Largest error of a pixel's position in the image; 0 computes every pixel exactly (unit px; at
        least 0; at most 10; default 0.05).
    nodata : str, optional
        Value of pixels that the image does not show, or mask for a mask band; by default the image's
        own, else a mask where the image has one, else 0 (NaN for floating point).
    format : str, optional
        Cloud-optimised GeoTIFF with overviews, or a plain tiled GeoTIFF (one of cog, gtiff; default
        cog).
    compression : str, optional
        Compression, all of them lossless (one of deflate, lzw, zstd, none; default deflate).
    scheduler : str, optional
        Address of a Dask scheduler whose workers find tie points or make orthoimages (they must see the
        files under the same paths); by default threads of this machine do. A block is always adjusted
        by this process.
    scheduler_ca : path, optional
        Certificates (PEM) of the authority that signed those of a scheduler at tls://HOST:PORT; this
        and the next two are by default as Dask's configuration (distributed.comm.tls) says.
    scheduler_certificate : path, optional
        Certificate (PEM) to show to a scheduler at tls://HOST:PORT.
    scheduler_key : path, optional
        Private key (PEM) of that certificate, where it is not in the same file.
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

    Compares orthoimages of one map grid, each with each that overlaps it, or all with a reference. In
    windows spread over the common ground the shift is measured to a few hundredths of a pixel by
    correlation and least squares, around the shift that the pair has in common (up to 256 px). Reports
    medians, robust spreads and 90th percentiles, and writes a layer of arrows. ``before`` names the
    folder of the orthoimages made with the original RPCs: both are then compared in the same windows.

    Parameters
    ----------
    images : path or Image or sequence of them
        Orthoimages.
    reference : path or rasterio dataset, optional
        Compare with this orthoimage instead of with one another.
    before : str, optional
        Folder with orthoimages of the same names, made before.
    window : int, optional
        Side of a window, even (unit px; at least 16; at most 512; default 48).
    search : int, optional
        Largest difference of a window's shift from the one common to the pair (unit px; at least 1; at
        most 256; default 8).
    min_correlation : float, optional
        Windows less alike than this do not count (at least 0; at most 1; default 0.6).
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
    jitter: float = 0.0,
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

    Takes pushbroom images of a fractal, textured ground through an exact physical camera, with RPCs
    whose orbit and attitude are wrong as a vendor's are. Writes images, terrain (ellipsoidal heights),
    ground points, image points and the truth of all of them, to test methods and to plan blocks.

    With ``dates`` the images are taken over a year: shading and cast shadows as the sun stands, crops
    and leaves by the season, ploughed fields, snow, buildings that stand up and of which some are built
    or torn down, cars, haze and gain. truth.gpkg then says what changed when.

    With ``laser_passes`` a laser altimeter flies over it: laser.csv holds its points as SlideRule
    writes them, with the noise and misfits of real ICESat-2 segments, and true_laser.gpkg what each
    met. With ``free_dem`` and ``free_ortho`` free_dem.tif is a DEM with the errors of Copernicus GLO-30
    (ellipsoidal heights; by what it is displaced stands in truth.json), and free_ortho.tif an
    orthoimage in four bands, from another season and some metres beside the truth; what free_ortho.tif
    is off by stands in report.json.

    Parameters
    ----------
    sensor : str, optional
        Sensor that takes the images (one of ikonos, quickbird, worldview-2, pleiades, spot5, wide-
        field; default pleiades).
    images : int, optional
        Number of images of each place and date (at least 1; at most 50; default 2).
    dates : int, optional
        Number of dates over a year, each seen from another side under its own sun; 1 takes all images
        on one day (at least 1; at most 366; default 1).
    off_nadir : float, optional
        Largest off-nadir angle of the views of many dates (unit deg; at least 0; at most 35; default
        20).
    size : int, optional
        Samples, and lines where those are not given, of each image (unit px; at least 64; default
        2000).
    lines : int, optional
        Lines of each image; 0 takes the samples (unit px; at least 0; default 0).
    along : sequence of str, optional
        Off-nadir angles along the track, one for each image of a place (unit deg).
    across : float, optional
        Off-nadir angle to the right of the track (unit deg; at least -50; at most 50; default 0).
    heading : float, optional
        Azimuth of the flight, and of the lines (unit deg; default 190).
    strips : int, optional
        Strips beside each other (at least 1; default 1).
    places : int, optional
        Places along each strip (at least 1; default 1).
    overlap : float, optional
        Share by which neighbouring places overlap (at least 0; at most 0.9; default 0.2).
    lon : float, optional
        Longitude of the scene's centre (unit deg; default 5.45).
    lat : float, optional
        Latitude of the scene's centre (unit deg; default 43.53).
    height : float, optional
        Mean ellipsoidal height (unit m; default 250).
    landform : str, optional
        What the ground is like: how high its relief is, and whether buildings stand on it (one of
        mountains, hills, farmland, city, flat; default farmland).
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
    jitter : float, optional
        Amplitude of the attitude's vibration, unknown to the vendor (unit px; at least 0; default 0).
    jitter_period : float, optional
        Period of the vibration (unit lines; at least 50; default 2000).
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
        Standard deviation of what all heights of the free DEM are off by (GLO-30: 4 m LE90, with the
        noise) (unit m; at least 0; default 2).
    free_dem_place : float, optional
        Standard deviation of each coordinate in plan by which the free DEM is displaced (GLO-30: 6 m
        CE90) (unit m; at least 0; default 2.8).
    free_ortho : float, optional
        Pixel size of an orthoimage as free ones are; 0 writes none (unit m; at least 0; default 0).
    free_ortho_error : float, optional
        Root mean square distance by which the free orthoimage lies beside the truth (unit m; at least
        0; default 5).
    free_ortho_corner : float, optional
        How far the north-eastern corner of the free orthoimage lies beside the rest of it (unit m; at
        least 0; default 0).
    free_ortho_change : float, optional
        How much of the ground looks different in the free orthoimage, as in another season (at least 0;
        at most 1; default 0.4).
    pixels : bool, optional
        Render the images; without, RPC files stand for them (default yes).
    ms : bool, optional
        Render multispectral images of larger pixels too (default no).
    ortho : bool, optional
        Write an orthophoto of the scene, georeferenced and free of errors (default no).
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
    """Registration of two images from their matched points, by kind of point.

    Carries the points of the first image to the second, by a transformation in image space or after the
    RPCs (over a DEM or at a height), and reports what is left over for centres and corners, each
    registering the images alone and all together. The images may have different resolutions. Residuals
    are in pixels of the second image, or in metres with ``gsd``.

    Parameters
    ----------
    image_points : path or table or array or GroundPoints or ImagePoints
        Points measured on both images.
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
        What the heights of the DEM refer to, where it is not what ``height_datum`` says.
    height : float, optional
        Ellipsoidal height of the ground, instead of a DEM (unit m).
    height_datum : str, optional
        What heights of ground points and DEM refer to: layer (as their CRS says), ellipsoidal, egm96,
        egm2008 or a geoid grid file (default layer).
    strict_datum : bool, optional
        Stop where the geoid that is meant or the grid of a better coordinate operation is not
        installed, instead of going on with the next best one (default no).
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

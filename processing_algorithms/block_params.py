"""Options that the algorithms on blocks share: where points come from, what is control, how to adjust and write."""

from __future__ import annotations

from .declare import COMMON_PARAMS, OUTPUT_PARAMS, Kind, Param
from .terrain import GROUND_CRS, HEIGHT_DATUM

#: Models that `adjust` knows; the engine's `MODELS` holds them (a test compares the two).
MODEL_CHOICES = ("none", "shift", "shift-drift", "conformal", "affine", "quadratic")
ROBUST_CHOICES = ("none", "huber", "cauchy", "tukey")
WRITE_CHOICES = ("copy", "in-place", "vrt", "sidecar", "none")
RESIDUAL_CRS_CHOICES = ("both", "wgs84", "utm")

IMAGES = Param(
    "images", Kind.IMAGES, "Images with RPC, or RPC files alone (_RPC.TXT, .RPB, XML, .geom)", required=True,
    metavar="IMAGE",
)  # fmt: skip

POINT_PARAMS = (
    Param(
        "gcps", Kind.POINTS, "Ground points with known position: a vector layer or CSV", metavar="FILE[|layername=L]"
    ),
    Param(
        "image-points", Kind.POINTS, "Where points were measured on the images; ground positions in it are not used",
        metavar="FILE",
    ),
    Param("gcp-ids", Kind.IDS, "These points are control, all other known points are check points", metavar="A,B,…"),
    Param("check-ids", Kind.IDS, "These points are check points", metavar="A,B,…"),
    GROUND_CRS,
    HEIGHT_DATUM,
)  # fmt: skip

ADJUST_PARAMS = (
    Param("model", Kind.CHOICE, "Correction of each image's RPC", default="shift", choices=MODEL_CHOICES),
    Param("robust", Kind.CHOICE, "Weight function against blunders", default="none", choices=ROBUST_CHOICES),
    Param(
        "reject", Kind.NUMBER, "Leave out tie measurements beyond this many sigmas and adjust again; 0 keeps all",
        default=4.0, minimum=0.0, unit="sigma", advanced=True, metavar="SIGMAS",
    ),
    Param(
        "check-as-ties", Kind.FLAG, "Image points of check points take part like tie points (never their survey)",
        default=False, advanced=True,
    ),
    Param(
        "sigma-image", Kind.NUMBER, "Standard deviation of image points whose file gives none", default=0.5,
        minimum=1e-6, unit="px", metavar="PX",
    ),
    Param(
        "sigma-gcp-xy", Kind.NUMBER, "Standard deviation of each horizontal GCP coordinate whose file gives none",
        default=0.2, minimum=1e-6, unit="m", metavar="M",
    ),
    Param(
        "sigma-gcp-h", Kind.NUMBER, "Standard deviation of GCP heights whose file gives none", default=0.3,
        minimum=1e-6, unit="m", metavar="M",
    ),
    Param(
        "sigma-shift", Kind.NUMBER,
        "Prior standard deviation of each image's shift; by default 100 px with GCPs, else the RPC's ERR_BIAS or 5 px",
        minimum=1e-9, unit="px", advanced=True, metavar="PX",
    ),
    Param(
        "sigma-drift", Kind.NUMBER,
        "Prior standard deviation of the correction's drift across an image; by default 1e-3 with GCPs, else 1e-4",
        minimum=1e-15, unit="px/px", advanced=True, metavar="X",
    ),
)  # fmt: skip

BLOCK_OUTPUT_PARAMS = (
    *OUTPUT_PARAMS,
    Param(
        "write", Kind.CHOICE,
        "Where refined RPCs go: into copies of the images, into the images themselves (write-rpc --restore brings the "
        "original back), into virtual images, into _RPC.TXT files, or nowhere; an RPC file without image gets a new "
        "_RPC.TXT",
        default="copy", choices=WRITE_CHOICES,
    ),
    Param(
        "residual-crs", Kind.CHOICE, "Coordinate systems of the residual layers", default="both",
        choices=RESIDUAL_CRS_CHOICES,
    ),
    Param("report", Kind.FLAG, "Write report.html", default=True),
    *COMMON_PARAMS,
)  # fmt: skip

"""Options that the algorithms on blocks share: where points come from, what is control, how to adjust and write."""

from __future__ import annotations

from ..files.terrain import GROUND_CRS, HEIGHT_DATUM
from ..interface.declare import COMMON_PARAMS, OUTPUT_PARAMS, Kind, Param

#: Rules that choose a model from the GCPs; the engine's `RULES` holds them (a test compares the two).
RULE_CHOICES = ("auto", "generic")
#: Models for blocks; the engine's `BLOCK_MODELS` holds them (a test compares the two).
BLOCK_MODEL_CHOICES = (
    "none", "shift", "shift-drift", "conformal", "affine", "quadratic", "ground-linear", "ground-quadratic",
    "object-shift", "object-scale-shift", "object-affine", "generic-position", "generic-shift", "generic-12",
    "generic-affine", "generic-full",
)  # fmt: skip
#: Models for single images with GCPs: new coefficients.
DIRECT_MODEL_CHOICES = ("direct", "bils", "idkf", "pg", "upoe", "slss")
MODEL_CHOICES = (*RULE_CHOICES, *BLOCK_MODEL_CHOICES)
ROBUST_CHOICES = ("none", "huber", "cauchy", "tukey")
VARIANCE_GROUP_CHOICES = ("kind-sensor", "kind", "sensor", "image", "kind-image")
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

SIGMA_PARAMS = (
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
)  # fmt: skip

ADJUST_PARAMS = (
    Param("model", Kind.CHOICE, "Correction of each image's RPC", default="shift", choices=MODEL_CHOICES),
    Param("robust", Kind.CHOICE, "Weight function against blunders", default="none", choices=ROBUST_CHOICES),
    Param(
        "reject", Kind.NUMBER,
        "Leave out tie measurements and GCPs that fail their test at this many sigmas (data snooping); 0 keeps all",
        default=4.0, minimum=0.0, unit="sigma", advanced=True, metavar="SIGMAS",
    ),
    Param(
        "check-as-ties", Kind.FLAG, "Image points of check points take part like tie points (never their survey)",
        default=False, advanced=True,
    ),
    *SIGMA_PARAMS,
    Param(
        "variance-components", Kind.FLAG,
        "Estimate the sigmas of image points by kind and sensor and of GCPs from the residuals, and adjust with them",
        default=False, advanced=True,
    ),
    Param(
        "variance-groups", Kind.CHOICE, "What tells groups of image points apart when their sigmas are estimated",
        default="kind-sensor", choices=VARIANCE_GROUP_CHOICES, advanced=True,
    ),
    Param(
        "sensor-images", Kind.IDS,
        "Images of one sensor, whose image points have one sigma; groups joined by +; by default images of like "
        "resolution", advanced=True, metavar="A+B,C+D,…",
    ),
    Param(
        "cross-validate", Kind.FLAG, "Predict each GCP by an adjustment without it", default=False, advanced=True,
    ),
    Param(
        "fixed-images", Kind.IDS, "Reference images, whose RPCs stay as they are", advanced=True, metavar="A,B,…",
    ),
    Param(
        "shared-images", Kind.IDS, "Images of one strip or orbit that get the same correction; groups joined by +",
        advanced=True, metavar="A+B,C+D,…",
    ),
    Param(
        "sigma-dem", Kind.NUMBER,
        "Standard deviation of the heights of --dem, which then hold the tie points; by default they hold none",
        minimum=1e-6, unit="m", advanced=True, metavar="M",
    ),
    Param(
        "sigma-shift", Kind.NUMBER,
        "Prior standard deviation of each image's shift; by default 100 px with GCPs, else the RPC's ERR_BIAS or 5 px",
        minimum=1e-9, unit="px", advanced=True, metavar="PX",
    ),
    Param(
        "sigma-drift", Kind.NUMBER,
        "Prior standard deviation of an image's drift; by default 1e-3 with GCPs, else 1e-4; where the model does not "
        "follow drift, which then is an error, 3e-5; 0: no drift",
        minimum=0.0, unit="px/px", advanced=True, metavar="X",
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
        "force-write", Kind.FLAG, "Write the refined RPCs although the verdict on the result is unusable",
        default=False, advanced=True,
    ),
    Param(
        "residual-crs", Kind.CHOICE, "Coordinate systems of the residual layers", default="both",
        choices=RESIDUAL_CRS_CHOICES,
    ),
    Param("report", Kind.FLAG, "Write report.html", default=True),
    *COMMON_PARAMS,
)  # fmt: skip

"""HRSI's engine: block triangulation of satellite images with RPC cameras, on arrays and objects.

The names below are the public interface; each is imported when it is first used, so that command line and plugin
start without the numerics. Every room of the engine shows more in a face of its own, for those who look deeper.
"""

# Made by scripts/make_stubs.py: change the declarations or the package, and run it again.

from .adjustment import Adjustment as Adjustment
from .adjustment import AdjustOptions as AdjustOptions
from .adjustment import adjust as adjust
from .block import Block as Block
from .block import GroundPoints as GroundPoints
from .block import Image as Image
from .block import ImagePoints as ImagePoints
from .block import Role as Role
from .block import assemble as assemble
from .camera import RPC as RPC
from .camera import fit_rpc as fit_rpc
from .foundation import HrsiError as HrsiError
from .io import open_image as open_image
from .io import read_rpc as read_rpc
from .measurement import TieOptions as TieOptions
from .measurement import find_tie_points as find_tie_points
from .plausibility import check_block as check_block
from .refinement import MODELS as MODELS
from .refinement.estimate import Control as Control
from .refinement.refine import refine_rpc as refine_rpc
from .refinement.selection import choose_model as choose_model
from .results.judged_block import judge as judge
from .results.residuals import compute_residuals as compute_residuals

"""Pictures as SVG and PNG text: maps, plots, image chips; they know no path and no GDAL."""

# Made by scripts/make_stubs.py: change the declarations or the package, and run it again.

from .block_map import BlockMap as BlockMap
from .block_map import TieField as TieField
from .block_map import draw_block_map as draw_block_map
from .distribution_plots import draw_histogram as draw_histogram
from .distribution_plots import draw_qq_plot as draw_qq_plot
from .image_cards import ImageCard as ImageCard
from .image_cards import draw_image_card as draw_image_card
from .pair_pictures import PictureSide as PictureSide
from .pair_pictures import draw_pair as draw_pair
from .residual_plots import draw_bars as draw_bars
from .residual_plots import draw_residual_vectors as draw_residual_vectors
from .target_chips import TargetChip as TargetChip
from .target_chips import draw_target_chip as draw_target_chip

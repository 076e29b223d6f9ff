"""Pictures as SVG and PNG text: maps, plots, image chips; they know no path and no GDAL."""

# Made by scripts/make_stubs.py: change the declarations or the package, and run it again.

from .block_map import BlockMap as BlockMap
from .block_map import TieField as TieField
from .block_map import block_map_svg as block_map_svg
from .distribution_plots import histogram_svg as histogram_svg
from .distribution_plots import qq_svg as qq_svg
from .image_cards import ImageCard as ImageCard
from .image_cards import card_svg as card_svg
from .pair_pictures import PictureSide as PictureSide
from .pair_pictures import pair_svg as pair_svg
from .residual_plots import bars_svg as bars_svg
from .residual_plots import residual_vectors_svg as residual_vectors_svg
from .target_chips import TargetChip as TargetChip
from .target_chips import chip_svg as chip_svg

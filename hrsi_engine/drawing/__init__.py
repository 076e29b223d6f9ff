"""Pictures as SVG and PNG text: maps, plots, image chips; they know no path and no GDAL."""

from ..foundation.lazy_names import lazy_names

__getattr__, __dir__, __all__ = lazy_names(__name__, {
    "block_map": "BlockMap TieField draw_block_map",
    "distribution_plots": "draw_histogram draw_qq_plot",
    "image_cards": "ImageCard draw_image_card",
    "pair_pictures": "PictureSide draw_pair",
    "residual_plots": "draw_bars draw_residual_vectors",
    "target_chips": "TargetChip draw_target_chip",
})  # fmt: skip

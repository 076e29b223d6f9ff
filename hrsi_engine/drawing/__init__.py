"""Pictures as SVG and PNG text: maps, plots, image chips; they know no path and no GDAL."""

from ..foundation.lazy_names import lazy_names

__getattr__, __dir__, __all__ = lazy_names(
    __name__,
    {
        "block_map": "BlockMap TieField block_map_svg",
        "distribution_plots": "histogram_svg qq_svg",
        "image_cards": "ImageCard card_svg",
        "pair_pictures": "PictureSide pair_svg",
        "residual_plots": "bars_svg residual_vectors_svg",
        "target_chips": "TargetChip chip_svg",
    },
)

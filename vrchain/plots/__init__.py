"""DataFrames and results to figures: matplotlib figures, which a notebook shows as they are."""

from typing import TYPE_CHECKING

from vrchain.lazy import lazy

if TYPE_CHECKING:
    from vrchain.plots.ledger import ledger_figure as ledger_figure
    from vrchain.plots.maps import scene_map as scene_map
    from vrchain.plots.missions import mission_figure as mission_figure
    from vrchain.plots.pictures import panorama_strip as panorama_strip
    from vrchain.plots.pictures import truth_sheet as truth_sheet
    from vrchain.plots.pictures import view_sheet as view_sheet
    from vrchain.plots.pictures import views_row as views_row
    from vrchain.plots.replay import gif_html as gif_html
    from vrchain.plots.replay import mission_gif as mission_gif
    from vrchain.plots.teams import chain_map as chain_map
    from vrchain.plots.teams import chain_of as chain_of
    from vrchain.plots.teams import team_graph as team_graph

_HOMES = {
    "chain_map": "teams",
    "chain_of": "teams",
    "gif_html": "replay",
    "ledger_figure": "ledger",
    "mission_figure": "missions",
    "mission_gif": "replay",
    "panorama_strip": "pictures",
    "scene_map": "maps",
    "team_graph": "teams",
    "truth_sheet": "pictures",
    "view_sheet": "pictures",
    "views_row": "pictures",
}
__all__ = list(_HOMES)
if not TYPE_CHECKING:  # or every name would be known
    __getattr__, __dir__ = lazy(__name__, _HOMES)

"""What a robot sees around it: the views of its camera rig, and the cylinder that joins them."""

import numpy as np
import pandas as pd

from vrchain.experiments.reproduction.results import Results, suburb
from vrchain.geometry import Pose
from vrchain.panorama import CameraRig
from vrchain.plots.pictures import view_sheet
from vrchain.plots.scripts import Drawn, run_script
from vrchain.world.render import Renderer

POSE = Pose(10.0, 0.0, 0.0)


def draw(results: Results) -> Drawn:
    """The views and the cylinder, and which view each bearing of the cylinder comes from."""
    rig = CameraRig()
    figure = view_sheet(Renderer(suburb()).render(POSE, rig))
    bearings_deg = np.arange(180, -180, -5.0)
    views = rig.view_of_bearing(np.radians(bearings_deg))
    columns_px = rig.column_of_bearing(np.radians(bearings_deg)).round(1)
    table = {"bearing_deg": bearings_deg, "view": views, "cylinder_column_px": columns_px}
    return figure, pd.DataFrame(table)


if __name__ == "__main__":
    run_script(__file__, draw)

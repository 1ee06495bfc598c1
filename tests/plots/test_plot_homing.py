"""The figure of home vectors: an arrow an answer, a cross where there is none."""

import numpy as np
import pandas as pd
from drawn import strays
from matplotlib.quiver import Quiver
from worlds import yard

from vrchain.geometry import Pose
from vrchain.plots.homing import home_vectors_figure


def test_arrows_point_where_they_were_told() -> None:
    x_m, y_m = (c.ravel() for c in np.meshgrid([-1.0, 0.0, 1.0], [1.0, 2.0]))
    course = np.arctan2(-y_m, -x_m)
    rows = {"x_m": x_m, "y_m": y_m, "course_rad": course, "answered": True, "error_deg": 0.0}
    ours, other = (pd.DataFrame(rows | {"method": name}) for name in ("ours", "theirs"))
    other.loc[0, ["course_rad", "error_deg"]] = np.nan, 90.0
    other.loc[0, "answered"] = False
    figure = home_vectors_figure(
        yard(), Pose(1.0, 2.0), pd.concat([ours, other]), ["ours", "theirs"]
    )
    assert strays(figure) == []
    arrows = [
        next(c for c in axes.collections if isinstance(c, Quiver)) for axes in figure.axes[:2]
    ]
    assert [len(a.U) for a in arrows] == [6, 5]
    assert np.allclose(arrows[0].get_offsets(), np.stack([1.0 + x_m, 2.0 + y_m], axis=1))
    assert np.allclose(np.arctan2(arrows[0].V, arrows[0].U), course)
    titles = [axes.get_title() for axes in figure.axes[:2]]
    assert titles == ["ours: 0.0° off on average",
                      "theirs: 15.0° off on average, 1 without an answer"]  # fmt: skip

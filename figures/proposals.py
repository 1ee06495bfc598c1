"""What the network proposes in one panorama: boxes, kinds and ranges."""

from vrchain.experiments.reproduction.results import Results, suburb
from vrchain.geometry import Pose
from vrchain.landmarks.extraction.record import examine
from vrchain.panorama import CameraRig
from vrchain.plots.landmarks import proposals_figure, proposals_table
from vrchain.plots.scripts import Drawn, run_script
from vrchain.world.render import Renderer

POSE = Pose(10.0, 0.0, 0.0)  # as in the figure of the panorama


def draw(results: Results) -> Drawn:
    """The proposals of the panorama of another figure."""
    panorama = Renderer(suburb()).render(POSE, CameraRig())
    found = examine(panorama).proposals
    return proposals_figure(panorama, found), proposals_table(found)


if __name__ == "__main__":
    run_script(__file__, draw)

"""Two robots, and the landmarks that both of them see."""

from vrchain.experiments.landmarks.pairs import draw_pairs
from vrchain.experiments.reproduction.results import Results, suburb
from vrchain.landmarks.matching.variants import DEFAULT, compared, variant_named
from vrchain.panorama import CameraRig
from vrchain.plots.pictures import claims_table, common_landmarks_figure
from vrchain.plots.scripts import Drawn, run_script
from vrchain.world.render import Renderer


def draw(results: Results) -> Drawn:
    """The first random pair of places, 5-10 m apart, of the profile's seed."""
    rig, renderer = CameraRig(), Renderer(suburb())
    poses = next(draw_pairs(suburb(), 1, (5.0, 10.0), results.profile.seed))
    a, b = (renderer.render(pose, rig) for pose in poses)
    claims = compared(variant_named(DEFAULT), a, b).common
    spacing_m = poses[0].distance_to_m(poses[1].xy_m)
    titles = ("what R1 sees", f"what R2 sees, {spacing_m:.1f} m away and turned otherwise")
    figure = common_landmarks_figure(a.cylinder, b.cylinder, claims, rig, titles)
    return figure, claims_table(claims)


if __name__ == "__main__":
    run_script(__file__, draw)

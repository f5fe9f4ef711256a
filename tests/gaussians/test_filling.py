import torch

from plop.gaussians.filling import OpacityGrid, fill_paper, inner_gaussians, solid_points
from tests.gaussians.clouds import sphere_shell

RADIUS = 0.05


def test_solid_fills_a_sphere_and_nothing_else():
    spacing = 0.008
    points = solid_points(sphere_shell(1500), spacing)
    radius = points.norm(dim=1)
    assert radius.max() < RADIUS
    # Evenly: every place well inside has a point nearby, and the number is that of the volume reached.
    probe = torch.rand(2000, 3, generator=torch.Generator().manual_seed(0)) * 2 * RADIUS - RADIUS
    probe = probe[probe.norm(dim=1) < 0.035]
    assert torch.cdist(probe, points).amin(1).max() < spacing
    expected = 4 / 3 * torch.pi * 0.04**3 / spacing**3
    assert abs(int((radius < 0.04).sum()) - expected) < 0.1 * expected


def test_a_table_closes_a_shell_without_bottom():
    shell = sphere_shell(1500)
    dome = shell.select(shell.means[:, 2] > 0)
    assert len(solid_points(dome, 0.008)) < 20
    points = solid_points(dome, 0.008, floor_z_m=0.0)
    assert points[:, 2].min() > 0
    assert points[:, 2].min() < 0.006, "the bottom is filled too"
    expected = 2 / 3 * torch.pi * 0.045**3 / 0.008**3
    assert abs(len(points) - expected) < 0.15 * expected


def test_an_open_shell_encloses_nothing():
    shell = sphere_shell(1500)
    points = solid_points(shell.select(shell.means[:, 0] > 0), 0.008)
    assert len(points) <= 2, "at most in a corner of the rim"


def test_paper_places_one_gaussian_at_each_transition():
    """A ray through a hollow sphere enters high opacity twice: new Gaussians lie in the shell, not in the middle."""
    shell = sphere_shell(1500)
    filled = fill_paper(shell)
    grid = OpacityGrid.around(shell, 16)
    assert 100 < len(filled) <= int((grid.opacity > 0.1).sum())
    assert (filled.means.norm(dim=1) > RADIUS - 2.5 * grid.cell_m).all()
    nearest = torch.cdist(filled.means, shell.means).argmin(1)
    assert torch.equal(filled.ids, shell.ids[nearest])
    assert torch.equal(filled.sh, shell.sh[nearest])


def test_inner_gaussians_inherit_colour_and_keep_off_the_shell():
    shell = sphere_shell(1500)
    points = torch.tensor([[0.0, 0, 0], [0.04, 0, 0], [0.049, 0, 0]])
    inner = inner_gaussians(points, shell, 0.008, opacity=0.9, overlap=0.5)
    assert inner.scales[0, 0] == 0.004
    assert inner.scales[2, 0] < 0.001, "two standard deviations end before the shell"
    assert inner.sh[1, 0, 0] > 0.45, "the colour of the shell at +x"


def test_the_middle_of_the_grid_is_empty_and_enclosed():
    grid = OpacityGrid.around(sphere_shell(1500), 16)
    enclosed = grid.enclosed(0.1)
    middle = tuple(((torch.zeros(3) - grid.origin) / grid.cell_m).long().tolist())
    assert enclosed[middle] and grid.opacity[middle] == 0
    rim = enclosed.clone()
    rim[1:-1, 1:-1, 1:-1] = False
    assert not rim.any()

import h5py
import pytest
import torch

from plop.errors import PlopError
from plop.gaussians.trajectory import Trajectory, TrajectoryWriter
from tests.gaussians.clouds import random_gaussians


def test_frames_of_any_size_come_back_exactly(tmp_path):
    frames = {
        ("predicted", 0): random_gaussians(5),
        ("predicted", 12): random_gaussians(9, seed=1),
        ("predicted", 3): random_gaussians(0),
        ("updated", 12): random_gaussians(7, seed=2),
    }
    with TrajectoryWriter(tmp_path / "a.h5") as writer:
        for (group, frame), blob in frames.items():
            writer.append(group, frame, blob, push=blob.means * 2, label=torch.arange(3))
    with Trajectory(tmp_path / "a.h5") as trajectory:
        assert trajectory.groups == ["predicted", "updated"]
        assert trajectory.frames("predicted") == [0, 3, 12]
        assert trajectory.frames("nothing") == []
        for (group, frame), blob in frames.items():
            back = trajectory.read(group, frame)
            for name in ("means", "quats", "scales", "opacities", "sh", "ids"):
                assert torch.equal(getattr(back, name), getattr(blob, name))
            assert torch.equal(trajectory.extra(group, frame, "push"), blob.means * 2)


def test_colours_are_stored_once_while_they_stay(tmp_path):
    blob, other = random_gaussians(100, terms=16), random_gaussians(100, seed=1, terms=16)
    with TrajectoryWriter(tmp_path / "a.h5") as writer:
        for frame, colours in enumerate([blob, blob, other, other, blob]):
            writer.append("states", frame, blob.with_(sh=colours.sh))
    with h5py.File(tmp_path / "a.h5") as file:
        assert [frame for frame in range(5) if "sh" in file[f"states/{frame}"]] == [0, 2, 4]
    with Trajectory(tmp_path / "a.h5") as trajectory:
        assert torch.equal(trajectory.read("states", 3).sh, other.sh)
        assert torch.equal(trajectory.read("states", 4).sh, blob.sh)


def test_a_failure_leaves_no_file_and_harms_no_old_one(tmp_path):
    with TrajectoryWriter(tmp_path / "a.h5") as writer:
        writer.append("states", 0, random_gaussians(3))
    before = (tmp_path / "a.h5").read_bytes()
    with pytest.raises(RuntimeError), TrajectoryWriter(tmp_path / "a.h5") as writer:
        writer.append("states", 0, random_gaussians(4))
        raise RuntimeError
    assert (tmp_path / "a.h5").read_bytes() == before
    assert [path.name for path in tmp_path.iterdir()] == ["a.h5"]


def test_the_same_states_give_the_same_bytes(tmp_path):
    for name in ("a.h5", "b.h5"):
        with TrajectoryWriter(tmp_path / name) as writer:
            writer.append("states", 0, random_gaussians(3), extra_thing=torch.ones(2))
    assert (tmp_path / "a.h5").read_bytes() == (tmp_path / "b.h5").read_bytes()


def test_bad_files_and_frames_are_explained(tmp_path):
    path = tmp_path / "a.h5"
    with pytest.raises(PlopError, match="no such trajectory"):
        Trajectory(path)
    with TrajectoryWriter(path) as writer:
        writer.append("states", 2, random_gaussians(3))
        with pytest.raises(PlopError, match="twice"):
            writer.append("states", 2, random_gaussians(3))
    with Trajectory(path) as trajectory:
        with pytest.raises(PlopError, match="no such frame") as error:
            trajectory.read("states", 9)
        assert "frames 2 to 2" in str(error.value)
        with pytest.raises(PlopError, match="one of the groups states"):
            trajectory.read("updated", 0)
        with pytest.raises(PlopError, match="incomplete"):
            trajectory.extra("states", 2, "push")
    torn = path.read_bytes()[:-100]
    path.write_bytes(torn)
    with pytest.raises(PlopError, match="cannot be opened"):
        Trajectory(path)
    with h5py.File(path, "w") as file:
        file.attrs["schema"] = 99
    with pytest.raises(PlopError, match="another schema") as error:
        Trajectory(path)
    assert "Update plop" in str(error.value)

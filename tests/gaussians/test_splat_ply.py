import numpy as np
import pytest
import torch
from torch.testing import assert_close

from plop.errors import PlopError
from plop.gaussians.splat_ply import read_splat, write_splat
from tests.gaussians.clouds import random_gaussians


@pytest.mark.parametrize("terms", [1, 4, 9, 16])
def test_write_then_read_gives_the_same(tmp_path, terms):
    blob = random_gaussians(50, terms=terms)
    write_splat(tmp_path / "a.ply", blob)
    back = read_splat(tmp_path / "a.ply")
    for name in ("means", "scales", "opacities", "sh"):
        assert_close(getattr(back, name), getattr(blob, name), rtol=1e-5, atol=1e-7)
    assert_close(back.quats, blob.quats)
    assert back.ids.tolist() == list(range(50))
    assert [path.name for path in tmp_path.iterdir()] == ["a.ply"]


def test_the_file_is_what_public_viewers_expect(tmp_path):
    """The layout of 3D Gaussian splatting's own files, spelled out."""
    blob = random_gaussians(1, terms=4)
    write_splat(tmp_path / "a.ply", blob)
    header, _, body = (tmp_path / "a.ply").read_bytes().partition(b"end_header\n")
    lines = header.decode().splitlines()
    assert lines[:3] == ["ply", "format binary_little_endian 1.0", "element vertex 1"]
    names = [line.removeprefix("property float ") for line in lines[3:]]
    assert names == [
        "x",
        "y",
        "z",
        "nx",
        "ny",
        "nz",
        "f_dc_0",
        "f_dc_1",
        "f_dc_2",
        *(f"f_rest_{i}" for i in range(9)),
        "opacity",
        "scale_0",
        "scale_1",
        "scale_2",
        "rot_0",
        "rot_1",
        "rot_2",
        "rot_3",
    ]
    row = dict(zip(names, np.frombuffer(body, "<f4"), strict=True))
    assert row["f_rest_0"] == blob.sh[0, 1, 0] and row["f_rest_3"] == blob.sh[0, 1, 1]  # colour by colour
    sigma = float(blob.opacities[0])
    assert row["opacity"] == pytest.approx(np.log(sigma / (1 - sigma)), rel=1e-5)
    assert row["scale_1"] == pytest.approx(float(blob.scales[0, 1].log()))
    assert row["rot_0"] == pytest.approx(float(blob.quats[0, 0]))


def test_other_orders_types_and_ascii_are_read(tmp_path):
    names = [
        "opacity",
        "rot_0",
        "rot_1",
        "rot_2",
        "rot_3",
        "scale_0",
        "scale_1",
        "scale_2",
        "x",
        "y",
        "z",
        "f_dc_0",
        "f_dc_1",
        "f_dc_2",
    ]
    values = [0.0, 2.0, 0, 0, 0, -5, -5, -6, 0.1, 0.2, 0.3, 1, 2, 3]
    header = "\n".join(
        [
            "ply",
            "format {}",
            "comment by hand",
            "element vertex 1",
            *(f"property double {name}" for name in names),
            "end_header",
            "",
        ]
    )
    binary = tmp_path / "big.ply"
    binary.write_bytes(header.format("binary_big_endian 1.0").encode() + np.array(values, ">f8").tobytes())
    text = tmp_path / "text.ply"
    text.write_text(header.format("ascii 1.0") + " ".join(map(str, values)) + "\n")
    for path in (binary, text):
        blob = read_splat(path)
        assert blob.opacities.item() == 0.5
        assert_close(blob.quats, torch.tensor([[1.0, 0, 0, 0]]))
        assert_close(blob.means, torch.tensor([[0.1, 0.2, 0.3]]))


def edited(path, **changes):
    data = path.read_bytes()
    for old, new in changes.values():
        assert old in data
        data = data.replace(old, new)
    path.write_bytes(data)


@pytest.mark.parametrize(
    ("spoil", "says"),
    [
        (lambda path: path.unlink(), "no such"),
        (lambda path: path.write_bytes(path.read_bytes()[:-10]), "truncated"),
        (lambda path: path.write_bytes(b"solid stl"), "not a PLY"),
        (lambda path: path.write_bytes(path.read_bytes()[:60]), "header"),
        (lambda path: edited(path, a=(b"element vertex", b"element vortex")), "header"),
        (lambda path: edited(path, a=(b"binary_little_endian", b"binary_middle_endian")), "header"),
        (lambda path: edited(path, a=(b"vertex 5", b"vertex 99999999999999")), "truncated"),
        (lambda path: edited(path, a=(b"property float opacity", b"property float opaque")), "does not hold Gaussians"),
        (lambda path: edited(path, a=(b"vertex 5", b"vertex x")), "header"),
        (lambda path: edited(path, a=(b"property float x\n", b"property list uchar int x\n")), "header"),
        (lambda path: edited(path, a=(b"f_rest_8", b"f_other")), "colours"),
    ],
)
def test_bad_files_are_explained(tmp_path, spoil, says):
    path = tmp_path / "a.ply"
    write_splat(path, random_gaussians(5))
    spoil(path)
    with pytest.raises(PlopError, match=says) as error:
        read_splat(path)
    assert str(path) in str(error.value)


def test_nan_is_refused_both_ways(tmp_path):
    blob = random_gaussians(5)
    write_splat(tmp_path / "a.ply", blob)
    data = bytearray((tmp_path / "a.ply").read_bytes())
    data[-4:] = np.array([np.nan], "<f4").tobytes()
    (tmp_path / "a.ply").write_bytes(bytes(data))
    with pytest.raises(PlopError, match="not finite") as error:
        read_splat(tmp_path / "a.ply")
    assert "rot_3 (1 Gaussians)" in str(error.value)

    blob.scales[2, 1] = 0.0
    with pytest.raises(PlopError, match="not finite"):
        write_splat(tmp_path / "b.ply", blob)
    assert not list(tmp_path.glob("b.ply*"))


def test_no_gaussians_make_a_round_trip(tmp_path):
    write_splat(tmp_path / "a.ply", random_gaussians(0))
    assert len(read_splat(tmp_path / "a.ply")) == 0

"""Ground truth of a simulator, for scoring. Nothing that trains, fits or filters may import this module."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from plop.artifacts.hdf5_reader import Hdf5Reader
from plop.errors import PlopError
from plop.recordings.recording import Mesh, Recording


class Truth(Hdf5Reader):
    """Read `/truth` of one recording lazily; use as a context manager."""

    noun, schema, maker = Recording.noun, Recording.schema, Recording.maker

    def _check(self) -> None:
        if "truth/surface_vertices_m" not in self._file:
            raise PlopError(
                "This recording has no ground truth.",
                where=f"{self.path}:/truth",
                expected="a recording of a simulator",
                found="nothing",
                fix="Score this recording by its images only.",
            )

    @staticmethod
    def is_in(path: str | Path) -> bool:
        """Return whether a recording has ground truth."""
        with h5py.File(path, "r") as file:
            return "truth/surface_vertices_m" in file

    def __len__(self) -> int:
        return len(self._file["truth/surface_vertices_m"])

    @property
    def has_nodes(self) -> bool:
        """Return whether the simulator's volume nodes are known, besides its surface."""
        return "truth/nodes_m" in self._file

    def nodes_m(self, frame: int, *, real_only: bool = True) -> np.ndarray:
        """Return the nodes of the volume mesh at one frame, shape [N, 3] [m].

        Args:
            frame: Index of the frame.
            real_only: Leave out nodes that the simulator duplicates for a cut (virtual nodes).
        """
        nodes = self._file["truth/nodes_m"][frame].astype(np.float64)
        return nodes[self.node_is_real] if real_only else nodes

    @property
    def node_is_real(self) -> np.ndarray:
        """Nodes that are not virtual, bool, shape [N]; all of them where the simulator has no virtual nodes."""
        if "truth/node_is_real" not in self._file:
            return np.ones(self._file["truth/nodes_m"].shape[1], bool)
        return self._file["truth/node_is_real"][:]

    @property
    def tets(self) -> np.ndarray:
        """Tetrahedra over all nodes, virtual ones included, shape [M, 4], int64."""
        return self._file["truth/tets"][:]

    @property
    def rest_nodes_m(self) -> np.ndarray:
        """All nodes at rest, virtual ones included, shape [N, 3] [m]."""
        return self._file["truth/rest_nodes_m"][:].astype(np.float64)

    def surface(self, frame: int) -> Mesh:
        """Return the closed surface at one frame; its faces are the same in every frame."""
        vertices = self._file["truth/surface_vertices_m"][frame].astype(np.float64)
        return Mesh(vertices, self._file["truth/surface_faces"][:])

    @property
    def rest_surface_vertices_m(self) -> np.ndarray:
        """Material position of every surface vertex, shape [V, 3] [m]."""
        return self._file["truth/surface_rest_vertices_m"][:].astype(np.float64)

    @property
    def surface_is_cut(self) -> np.ndarray:
        """Faces created by the cut, bool, shape [F]."""
        return self._file["truth/surface_is_cut"][:]

    @property
    def facts(self) -> dict[str, Any]:
        """Parameters of the simulator."""
        return json.loads(self._file["truth"].attrs.get("facts", "{}"))

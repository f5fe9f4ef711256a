"""The same press in the worlds' own tetrahedra. Unmaintained."""

# ruff: noqa
import numpy as np, scipy.sparse as sp, scipy.sparse.linalg as sl, sys, time
from dataclasses import replace
from benchmarks.worlds.scene import *


def solve(cells, E=15e3, nu=0.4, depth=0.0063, cx=0.004, punch=0.01, kpen=2e7):
    w = World(cells_m=cells)
    m = tetrahedral_mesh(w)
    X, T = m.nodes, m.tetrahedra
    lam = E * nu / (1 + nu) / (1 - 2 * nu)
    mu = E / 2 / (1 + nu)
    C = np.diag([2 * mu] * 3 + [mu] * 3)
    C[:3, :3] += lam
    D = X[T[:, 1:]] - X[T[:, :1]]
    V = np.linalg.det(D) / 6
    inv = np.linalg.inv(D)  # rows edges; grads = columns of inv
    G = np.concatenate([-inv.sum(2)[:, None, :], np.swapaxes(inv, 1, 2)], 1)
    B = np.zeros((len(T), 6, 12))
    for a in range(4):
        x, y, z = G[:, a].T
        o = 0 * x
        B[:, :, 3 * a : 3 * a + 3] = np.stack(
            [np.stack(r, -1) for r in ([x, o, o], [o, y, o], [o, o, z], [y, x, o], [z, o, x], [o, z, y])], 1
        )
    K = np.einsum("eij,ik,ekl->ejl", B, C, B) * V[:, None, None]
    dof = (3 * T[:, :, None] + np.arange(3)).reshape(len(T), 12)
    n = 3 * len(X)
    A = sp.coo_matrix((K.ravel(), (np.repeat(dof, 12, 1).ravel(), np.tile(dof, (1, 12)).ravel())), shape=(n, n)).tocsr()
    fr = np.repeat(X[:, 2] > 1e-9, 3)
    # contact samples
    g = np.arange(-punch + 0.00025, punch, 0.0005)
    P = np.stack(np.meshgrid(g + cx, g, indexing="ij"), -1).reshape(-1, 2)
    F = m.surface[m.faces]
    F = F[(X[F][:, :, 2] > 0.04 - 1e-9).all(1)]
    rows, cols, vals = [], [], []
    for f in F:
        a, b, c = X[f][:, :2]
        M = np.linalg.inv(np.array([[*a, 1], [*b, 1], [*c, 1]]).T)
        L = (M @ np.c_[P, np.ones(len(P))].T).T
        k = np.nonzero((L > -1e-9).all(1))[0]
        rows += [k] * 3
        cols += [np.full(len(k), 3 * v + 2) for v in f]
        vals += list(L[k].T)
    N = sp.coo_matrix((np.concatenate(vals), (np.concatenate(rows), np.concatenate(cols))), shape=(len(P), n)).tocsr()
    act = np.ones(len(P), bool)
    area = 0.0005**2
    for _ in range(12):
        Na = N[act]
        S = A + kpen * area * Na.T @ Na
        b = -kpen * area * depth * np.asarray(Na.sum(0) * 0).ravel() - kpen * area * (Na.T @ np.full(act.sum(), depth))
        u = np.zeros(n)
        u[fr] = sl.spsolve(S[fr][:, fr].tocsc(), b[fr])
        new = (N @ u + depth) > 0
        if (new == act).all():
            break
        act = new
    p = kpen * area * (N[act] @ u + depth).sum()
    u = u.reshape(-1, 3)
    r = np.linalg.norm(X[:, :2] - [cx, 0], axis=1)
    top = X[:, 2] > 0.04 - 1e-9
    bot = X[:, 2] < 1e-9
    surf = (np.abs(X[:, 0]) > 0.03 - 1e-9) | (np.abs(X[:, 1]) > 0.02 - 1e-9)
    R = {
        "top<8": top & (r < 0.008),
        "top12-16": top & (r > 0.012) & (r < 0.016),
        "top>16": top & (r > 0.016),
        "side hi": surf & ~top & (X[:, 2] > 0.02),
        "side lo": surf & ~bot & (X[:, 2] <= 0.02),
    }
    print(
        cells,
        len(X),
        "force",
        round(p, 2),
        "E_eff",
        None,
        {k: (1000 * u[v].mean(0)).round(2).tolist() for k, v in R.items() if v.any()},
        flush=True,
    )


for c in (0.01, 0.0067, 0.005, 0.004, 0.0033):
    solve(c)

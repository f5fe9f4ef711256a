"""A shallow press in hexahedra, B-bar: what is exact. Unmaintained."""

# ruff: noqa
import numpy as np, scipy.sparse as sp, scipy.sparse.linalg as sl, sys, time


def solve(
    n,
    size=(0.06, 0.04, 0.04),
    E=15e3,
    nu=0.4,
    depth=0.0063,
    punch=0.010,
    cx=0.004,
    bonded_top=True,
    bonded_bottom=True,
    F_body=0,
):
    h = np.array(size) / n
    nn = np.array(n) + 1
    idx = np.arange(nn.prod()).reshape(nn)
    X = np.stack(np.meshgrid(*[np.linspace(0, size[k], nn[k]) for k in range(3)], indexing="ij"), -1).reshape(-1, 3)
    X[:, :2] -= np.array(size[:2]) / 2
    cells = np.stack(
        [
            idx[i : nn[0] - 1 + i, j : nn[1] - 1 + j, k : nn[2] - 1 + k].ravel()
            for i in (0, 1)
            for j in (0, 1)
            for k in (0, 1)
        ],
        1,
    )
    lam = E * nu / (1 + nu) / (1 - 2 * nu)
    mu = E / 2 / (1 + nu)
    C = np.diag([2 * mu] * 3 + [mu] * 3)
    C[:3, :3] += lam
    g = 1 / np.sqrt(3)
    loc = np.array([[i, j, k] for i in (-1, 1) for j in (-1, 1) for k in (-1, 1)], float)

    def dN(q):
        d = np.zeros((8, 3))
        for a in range(8):
            for c in range(3):
                v = loc[a, c] / 8
                for o in range(3):
                    if o != c:
                        v *= 1 + loc[a, o] * q[o]
                d[a, c] = v
        return d * 2 / h

    def B(d):
        b = np.zeros((6, 24))
        for a in range(8):
            x, y, z = d[a]
            b[:, 3 * a : 3 * a + 3] = [[x, 0, 0], [0, y, 0], [0, 0, z], [y, x, 0], [z, 0, x], [0, z, y]]
        return b

    Bs = [B(dN(g * l)) for l in loc]
    m = np.array([1, 1, 1, 0, 0, 0])[:, None]
    mean = sum(m.T @ b for b in Bs) / 8
    K = np.zeros((24, 24))
    for b in Bs:
        bb = b + m @ (mean - m.T @ b) / 3  # B-bar
        K += bb.T @ C @ bb * h.prod() / 8
    dof = (3 * cells[:, :, None] + np.arange(3)).reshape(len(cells), 24)
    A = sp.coo_matrix(
        (np.tile(K.ravel(), len(cells)), (np.repeat(dof, 24, 1).ravel(), np.tile(dof, (1, 24)).ravel())),
        shape=(3 * len(X),) * 2,
    ).tocsr()
    fixed = np.zeros(3 * len(X), bool)
    val = np.zeros(3 * len(X))
    bot = X[:, 2] < 1e-9
    top = X[:, 2] > size[2] - 1e-9
    fixed[2::3] |= bot
    if bonded_bottom:
        fixed[0::3] |= bot
        fixed[1::3] |= bot
    else:
        mid = bot & (np.abs(X[:, :2]) < 1e-6).all(1)
        fixed[0::3] |= mid
        fixed[1::3] |= mid
    und = top & (np.abs(X[:, 0] - cx) < punch + 1e-6) & (np.abs(X[:, 1]) < punch + 1e-6)
    fixed[2::3] |= und
    val[2::3][und] = -depth
    if bonded_top:
        fixed[0::3] |= und
        fixed[1::3] |= und
    u = val.copy()
    fr = ~fixed
    u[fr] = sl.spsolve(A[fr][:, fr].tocsc(), -(A[fr] @ val))
    f = (A @ u).reshape(-1, 3)
    u = u.reshape(-1, 3)
    r = np.linalg.norm(X[:, :2] - [cx, 0], axis=1)
    surf = (np.abs(X[:, 0]) > size[0] / 2 - 1e-9) | (np.abs(X[:, 1]) > size[1] / 2 - 1e-9)
    R = {
        "top<8": top & (r < 0.008),
        "top12-16": top & (r > 0.012) & (r < 0.016),
        "top>16": top & (r > 0.016),
        "side hi": surf & ~top & (X[:, 2] > 0.02),
        "side lo": surf & ~bot & (X[:, 2] <= 0.02),
    }
    global LAST
    LAST = (X, u, nn, size)
    print(
        n,
        bonded_top,
        bonded_bottom,
        "force",
        f[und, 2].sum().round(2),
        "bottom lift force",
        f[bot, 2][f[bot, 2] < 0].sum().round(2),
        {k: (1000 * u[v].mean(0)).round(2).tolist() for k, v in R.items()},
    )


def at(points):
    from scipy.interpolate import RegularGridInterpolator as I

    X, u, nn, size = LAST
    ax = [np.unique(X[:, k].round(9)) for k in range(3)]
    return I(ax, u.reshape(*nn, 3), bounds_error=False, fill_value=None)(points)


if __name__ == "__main__":
    for n in ((15, 10, 10), (30, 20, 20)):
        for bt, bb in ((True, True), (False, True)):
            solve(n, bonded_top=bt, bonded_bottom=bb)

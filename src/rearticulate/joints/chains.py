"""Do one, two or three joints in series explain how two parts move against each other?

The relative poses A_f are compared with prod_k exp(q_fk s_k) under the information W_f that registration left about
them, so unobservable directions weigh nothing. The cost over sigma^2 is a chi-square. A few frames in which a part was
lost have no say, and the joint stays there as it was in the frame before.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from rearticulate.arrays import Array, Bool, Float, Int
from rearticulate.geometry.se3 import adjoint, exp_se3, inverse, log_se3, log_so3
from rearticulate.joints.articulated import MAX_STEP, normalise_twists
from rearticulate.observe.fused import points_behind

LOST = 4.0  # spacings; rms misfit of a part's points in a frame beyond which its pose may be wrong there ...
LOST_SHARE = 0.2  # ... as it may be in this share of the frames
FORGOTTEN = 1e-3  # weight of such a frame


@dataclass(frozen=True)
class ChainFit:
    """k joints in series for each of B pairs, or for one pair alone, whose cost is a number."""

    cost: Float[Any, "*B"]
    twist: Float[Array, "*B k 6"]
    q: Float[Array, "*B F k"]
    revolute: Bool[Array, "*B k"]

    def take(self, b: int | Int[Array, " n"]) -> ChainFit:
        return ChainFit(self.cost[b], self.twist[b], self.q[b], self.revolute[b])


def relative_motion(
    T: Float[Array, "F P 4 4"], H: Float[Array, "F P 6 6"], a: Int[Array, " B"], b: Int[Array, " B"], canonical: int
) -> tuple[Float[Array, "B F 4 4"], Float[Array, "B F 6 6"]]:
    """Motion A of parts a seen from parts b, canonical coordinates, and its information W.

    W is the parallel sum of the two registrations' information: what both know.
    """
    T, H = np.swapaxes(T, 0, 1), np.swapaxes(H, 0, 1)  # (P, F, ...)
    A = inverse(T[b]) @ T[a]
    Ad = adjoint(T[b])
    Ad_t = np.swapaxes(Ad, -1, -2)
    Wa, Wb = Ad_t @ H[a] @ Ad, Ad_t @ H[b] @ Ad
    total = Wa + Wb
    size = np.trace(total[..., 3:, 3:], axis1=-2, axis2=-1)[..., None, None]
    ridge = 1e-7 * (size + 1) * np.diag([350.0] * 3 + [1.0] * 3)
    W = Wa - Wa @ np.linalg.solve(total + ridge, Wa)
    W = (W + np.swapaxes(W, -1, -2)) / 2
    W[:, canonical] = 0
    return A, W


def squares_by_frame(e: Float[Array, "*batch F 6"], W: Float[Array, "*batch F 6 6"]) -> Float[Array, "*batch F"]:
    """e' W e."""
    return np.einsum("...fi,...fij,...fj->...f", e, W, e)


def weighted_square(e: Float[Array, "*batch F 6"], W: Float[Array, "*batch F 6 6"]) -> Float[Array, "*batch"]:
    """Sum over frames of e' W e."""
    return squares_by_frame(e, W).sum(axis=-1)


def trust(squares: Float[Array, "B F"], W: Float[Array, "B F 6 6"]) -> Float[Array, "B F"]:
    """Weight of frames with these squared misfits under information W: hardly any for those, a share of them at
    most, where one of the parts is so far away that it was lost."""
    lost = squares > LOST**2 * points_behind(W)
    rank = np.argsort(np.argsort(-squares, axis=1, kind="stable"), axis=1, kind="stable")
    return np.where(lost & (rank < int(LOST_SHARE * squares.shape[1])), FORGOTTEN, 1.0)


def kept(q: Float[Array, "B F k"], trusted: Bool[Array, "B F"], canonical: int) -> Float[Array, "B F k"]:
    """Joint values q, where they are not trusted those of the frame before, seen from the canonical one."""
    q = q.copy()
    for step, end in ((1, q.shape[1]), (-1, -1)):
        for f in range(canonical + step, end, step):
            lost = ~trusted[:, f]
            q[lost, f] = q[lost, f - step]
    return q


def rest_cost(A: Float[Array, "B F 4 4"], W: Float[Array, "B F 6 6"]) -> Float[Array, " B"]:
    """Cost of no joint at all."""
    return weighted_square(log_se3(A), W)


def fit_chain(
    A: Float[Array, "B F 4 4"],
    W: Float[Array, "B F 6 6"],
    twist: Float[Array, "B k 6"],
    q: Float[Array, "B F k"],
    revolute: Bool[Array, "B k"],
    canonical: int,
    iterations: int = 14,
) -> ChainFit:
    """Gauss-Newton from twist, q; joint values are eliminated frame by frame. Best iterate kept; frames with a lost
    part (`trust`) hardly count."""
    B, F = A.shape[:2]
    k = twist.shape[1]
    best = ChainFit(np.full(B, np.inf), twist.copy(), q.copy(), revolute)
    trusted = np.ones((B, F), dtype=bool)
    damp_q = 3e-3 * np.where(revolute, 3.5, 1e-4)
    damp_s = 3e-3 * np.tile(np.array([350.0] * 3 + [1.0] * 3), k)
    limit_q = np.where(revolute, 0.1, 18.0)[:, None]
    for i in range(iterations + 1):
        steps = exp_se3(q[..., None] * twist[:, None])  # (B, F, k, 4, 4)
        before = np.empty_like(steps)
        T = np.broadcast_to(np.eye(4), (B, F, 4, 4))
        for j in range(k):
            before[:, :, j] = T
            T = T @ steps[:, :, j]
        e = log_se3(A @ inverse(T))
        squares = squares_by_frame(e, W)
        w = trust(squares, W)
        cost = (w * squares).sum(axis=1)
        better = cost < best.cost
        for mine, new in zip((best.cost, best.twist, best.q, trusted), (cost, twist, q, w == 1), strict=True):
            mine[better] = new[better]
        if i == iterations:
            break
        Ad = adjoint(before)
        Jq = np.swapaxes((Ad @ twist[:, None, :, :, None])[..., 0], -1, -2)  # (B, F, 6, k)
        Js = np.moveaxis(Ad @ (np.eye(6) - adjoint(steps)), 2, 3).reshape(B, F, 6, 6 * k)
        V = w[..., None, None] * W
        VJq, Ve = V @ Jq, (V @ e[..., None])[..., 0]
        Hqq = np.swapaxes(Jq, -1, -2) @ VJq + np.eye(k) * damp_q[:, None, None, :]
        Hqs = np.swapaxes(VJq, -1, -2) @ Js
        gq = np.einsum("bfik,bfi->bfk", Jq, Ve)
        Hss = np.einsum("bfia,bfic->bac", Js, V @ Js) + np.diag(damp_s)
        gs = np.einsum("bfia,bfi->ba", Js, Ve)
        solved = np.linalg.solve(Hqq, np.concatenate([Hqs, gq[..., None]], -1))
        S = Hss - np.einsum("bfka,bfkc->bac", Hqs, solved[..., :-1])
        r = gs - np.einsum("bfka,bfk->ba", Hqs, solved[..., -1])
        ds = np.linalg.solve(S, r[..., None])[..., 0]
        dq = solved[..., -1] - np.einsum("bfka,ba->bfk", solved[..., :-1], ds)
        eta = np.clip(ds.reshape(B, k, 6), -MAX_STEP, MAX_STEP)
        twist = normalise_twists((adjoint(exp_se3(eta)) @ twist[..., None])[..., 0], revolute)
        q = q + np.clip(dq, -limit_q, limit_q)
        q[:, canonical] = 0
    return replace(best, q=kept(best.q, trusted, canonical))


def fit_revolute(
    A: Float[Array, "B F 4 4"], W: Float[Array, "B F 6 6"], canonical: int, iterations: int = 10
) -> ChainFit:
    """One revolute joint, from the motion of all frames, and of the half of them nearest to the canonical one, where
    fewer parts are lost; the better of the two for each pair."""
    away = np.abs(np.arange(A.shape[1]) - canonical)
    near = away <= np.sort(away)[len(away) // 2]
    starts = [_turn(A, known, canonical) for known in (W, W * near[:, None, None])]
    twist, q = (np.stack(each, axis=1).reshape(-1, *each[0].shape[1:]) for each in zip(*starts, strict=True))
    A, W = np.repeat(A, len(starts), axis=0), np.repeat(W, len(starts), axis=0)
    fit = fit_chain(A, W, twist[:, None], q[..., None], np.ones((len(A), 1), bool), canonical, iterations)
    return best_start(fit, len(starts))


def best_start(fit: ChainFit, starts: int) -> ChainFit:
    """The best of each pair, of a fit in which each has so many starts, one after the other."""
    cost = fit.cost.reshape(-1, starts)
    return fit.take(cost.argmin(axis=1) + starts * np.arange(len(cost)))


def _turn(
    A: Float[Array, "B F 4 4"], W: Float[Array, "B F 6 6"], canonical: int
) -> tuple[Float[Array, "B 6"], Float[Array, "B F"]]:
    """Twist and values to start from: principal rotation axis, centre of least displacement."""
    w, M = log_so3(A[..., :3, :3]), np.eye(3) - A[..., :3, :3]
    known = np.trace(W[..., 3:, 3:], axis1=-2, axis2=-1) + 1e-9
    axis = np.linalg.eigh(np.einsum("bf,bfi,bfj->bij", known, w, w))[1][..., 2]
    MtM = np.einsum("bf,bfji,bfjk->bik", known, M, M)
    ridge = 1e-5 * known.sum(1)[:, None, None] * np.eye(3)
    origin = np.linalg.solve(MtM + ridge, np.einsum("bf,bfji,bfj->bi", known, M, A[..., :3, 3])[..., None])[..., 0]
    q = np.einsum("bfi,bi->bf", w, axis)
    q[:, canonical] = 0
    return np.concatenate([axis, np.cross(origin, axis)], -1), q


def fit_prismatic(
    A: Float[Array, "B F 4 4"],
    W: Float[Array, "B F 6 6"],
    centre: Float[Array, "B 3"],
    canonical: int,
    iterations: int = 8,
) -> ChainFit:
    """One prismatic joint; start: principal displacement of the moving part's centre."""
    d = np.einsum("bfij,bj->bfi", A[..., :3, :3], centre) + A[..., :3, 3] - centre[:, None]
    axis = np.linalg.svd(d, full_matrices=False)[2][:, 0]
    q = np.einsum("bfi,bi->bf", d, axis)
    q[:, canonical] = 0
    twist = np.concatenate([np.zeros_like(axis), axis], -1)
    return fit_chain(A, W, twist[:, None], q[..., None], np.zeros((len(A), 1), bool), canonical, iterations)


def fit_series(
    A: Float[Array, "B F 4 4"],
    W: Float[Array, "B F 6 6"],
    contact: Float[Array, "B 3"],
    k: int,
    canonical: int,
    starts: int,
    seed: int = 0,
) -> ChainFit:
    """k revolute joints in series near the contact, from several starts; the best of each pair."""
    B, F = A.shape[:2]
    rng = np.random.default_rng(seed)
    w = log_so3(A[..., :3, :3])
    V = np.linalg.svd(w, full_matrices=True)[2] if F >= 3 else np.broadcast_to(np.eye(3), (B, 3, 3))
    directions = []
    for s in range(starts):
        if s == 0:
            directions.append(V[:, :k])
        elif s == 1:
            directions.append(V[:, [1, 0, 2]][:, :k])
        else:
            Q = np.linalg.qr(rng.normal(size=(3, 3)))[0]
            directions.append(np.broadcast_to(Q[:k], (B, k, 3)))
    d = np.stack(directions, 1).reshape(B * starts, k, 3)
    many = [np.repeat(a, starts, axis=0) for a in (A, W, contact, w)]
    twist = np.concatenate([d, np.cross(np.broadcast_to(many[2][:, None], d.shape), d)], -1)
    q = np.einsum("bfi,bki->bfk", many[3], d)
    q[:, canonical] = 0
    fit = fit_chain(many[0], many[1], twist, q, np.ones((B * starts, k), bool), canonical)
    return best_start(fit, starts)

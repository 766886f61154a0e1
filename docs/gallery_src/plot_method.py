"""
The method in one dimension
===========================

What a sparse reduced model computes, on a rod that one can take in at a glance: why the sampled
rows must carry the load, what :math:`D^{-1}` changes, what coherence does to the choice of atoms,
and where a tight frame helps. Ten minutes to read, a few seconds to run, NumPy only but for the
tight frame.

A rod, and its full-order steps
-------------------------------

A rod of length 1 is kept at temperature 0 on the left, is insulated on the right, and is heated at
one point by the power w(t). With n = 200 linear elements and implicit Euler steps of length h, each
step solves :math:`D\\,T = b`, where :math:`D = C/h + K` and
:math:`b = C\\,T_\\mathrm{old}/h + f`. The load vector f is zero in every row but one.
"""

import matplotlib.pyplot as plt
import numpy as np

n, h, heated = 200, 0.005, 119
x = np.arange(1, n + 1) / n
K = n * (2 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1))  # conduction
C = np.eye(n) / n  # heat capacity, lumped
K[-1, -1], C[-1, -1] = n, 0.5 / n
D = C / h + K
inverse = np.linalg.inv(D)  # for the demonstration; sparsemor factorizes D and solves


def run(solve, power, steps=100):
    """Temperatures (steps + 1, n) of a run whose steps are solved by `solve(b)`."""
    T = [np.zeros(n)]
    for step in range(1, steps + 1):
        b = C @ T[-1] / h
        b[heated] += power(step * h)
        T.append(solve(b))
    return np.array(T)


def oscillating(t):
    return np.sin(10 * t)


training = run(lambda b: inverse @ b, lambda t: 1.0)  # constant power
full = run(lambda b: inverse @ b, oscillating)  # the run to be predicted

# %%
# Atoms
# -----
#
# Temperatures are sought as :math:`T = A\,c`. The columns of A are the *atoms*, here the first five
# POD modes of the training run with constant power; the prediction is for an oscillating one, which
# five modes can represent to 7e-5 and no better.

A = np.linalg.svd(training.T, full_matrices=False)[0][:, :5]


def error(T):
    """Largest error over time, relative to the largest temperature."""
    return np.abs(T - full).max() / np.abs(full).max()


representable = error(full @ A @ A.T)

fig, axes = plt.subplots(1, 2, figsize=(8, 2.8), layout="constrained")
axes[0].plot(x, full[[20, 40, 60, 80, 100]].T)
axes[0].set(xlabel="x", ylabel="temperature", title="full order, five times")
axes[1].plot(x, A)
axes[1].set(xlabel="x", ylabel="entry", title="the five atoms")
plt.show()

# %%
# A step of the reduced model
# ---------------------------
#
# **Galerkin projection** multiplies all n equations by the atoms: :math:`A^T D A\,c = A^T b`.
#
# **The method of Liang et al.** evaluates only sampled rows :math:`\Omega` of the residual
# :math:`r = D A c - b`, more rows than atoms, and solves them by least squares. Nothing is
# projected: a nonlinear term would be evaluated in the elements next to the sampled rows, and
# nowhere else.


def galerkin(b):
    return A @ np.linalg.solve(A.T @ D @ A, A.T @ b)


def sampled(rows):
    """Least squares on sampled rows of r."""
    fit = np.linalg.pinv(D[rows] @ A)
    return lambda b: A @ (fit @ b[rows])


def sampled_error(rows):
    """Least squares on sampled rows of D^-1 r = A c - D^-1 b, the error of T itself."""
    fit = np.linalg.pinv(A[rows])
    return lambda b: A @ (fit @ (inverse[rows] @ b))


# %%
# Rows must carry the load; what D^-1 changes
# -------------------------------------------
#
# Twenty random draws of rows for each number of rows, three ways: rows of r without the heated one,
# the same with the heated row in the place of one of them, and rows of :math:`D^{-1} r`.

numbers = (8, 12, 16, 24, 40)
ways = {"r, heated row left out": [], "r, heated row kept": [], "$D^{-1} r$, no row kept": []}
for m in numbers:
    found = []
    for seed in range(20):
        rows = np.random.default_rng(seed).choice(np.delete(np.arange(n), heated), m, replace=False)
        kept = np.append(rows[1:], heated)
        found.append([error(run(solve, oscillating)) for solve in (
            sampled(rows), sampled(kept), sampled_error(rows))])
    for way, errors in zip(ways.values(), np.transpose(found), strict=True):
        way.append(np.percentile(errors, (0, 50, 100)))

fig, ax = plt.subplots(figsize=(7, 3.6), layout="constrained")
for (name, values), mark in zip(ways.items(), "sov", strict=True):
    low, middle, high = np.transpose(values)
    ax.fill_between(numbers, low, np.minimum(high, 3), alpha=0.2)
    ax.semilogy(numbers, middle, mark + "-", label=name)
ax.axhline(error(run(galerkin, oscillating)), color="k", ls="--", label="Galerkin")
ax.set(xlabel="sampled rows", ylabel="largest error", ylim=(3e-5, 3),
       title="Error of the prediction by the number of sampled rows")
ax.legend(ncols=2)
plt.show()

# %%
# Lines are medians, bands the range of the draws. Three things to see:
#
# * **Without the heated row the model does not move**: its error is 1, exactly. Every sampled
#   equation reads :math:`(D A c)_i = (C\,T_\mathrm{old}/h)_i`; the rod starts at 0, so c = 0 solves
#   all of them, in every step, whatever the power. No basis and no preconditioner can repair that:
#   the load is not in the equations that are kept. Therefore ``sparse`` always keeps the rows that
#   loads and joints act on.
# * **Rows of** :math:`D^{-1} r` **need no such care.** :math:`D^{-1} b` is the full-order answer to
#   the load, which is felt in every row.
# * **They also weigh the error differently.** Where five atoms cannot satisfy all equations, the
#   least squares of r minimize :math:`D` times the error, which counts wiggles far more than smooth
#   errors; those of :math:`D^{-1} r` minimize the error itself at the sampled points: the median is
#   about half as large, and near to what the atoms can represent. That is the default of
#   ``sparse``. It costs one row of :math:`D^{-1}` for each sampled row, once, before the run; and
#   terms that are known only in a step, such as contact, have no such rows in advance.
#
# Few rows are a lottery with either: of 20 draws of 8 rows of r, one even diverges. With five rows
# per atom the worst draw has an error of 2e-3.
#
# Which atoms? What coherence does
# --------------------------------
#
# With many atoms one wants few of them active: *sparse* coefficients. A greedy solver (here
# orthogonal matching pursuit) takes the atom whose column of :math:`B = (D A)_\Omega` resembles the
# residual most, solves, and goes on. It goes wrong where columns resemble each other. The *mutual
# coherence* is the largest cosine between two columns; only below 1/(2s - 1) is it certain that s
# atoms are found. Sixty bumps as atoms, four of them active, 30 random rows:

from sparsemor.plugins.preconditioners.untf import UnitNormTightFrame  # noqa: E402


def pursuit(B, b, s=4):
    """The s columns that orthogonal matching pursuit takes for b."""
    taken, r = [], b
    for _ in range(s):
        score = np.abs(B.T @ r) / np.linalg.norm(B, axis=0)
        score[taken] = 0
        taken.append(int(score.argmax()))
        r = b - B[:, taken] @ np.linalg.lstsq(B[:, taken], b, rcond=None)[0]
    return set(taken)


def found_by(B, trials=100):
    """Share of random sparse states whose atoms are found from B c."""
    random = np.random.default_rng(0)
    hits = 0
    for _ in range(trials):
        support = random.choice(B.shape[1], 4, replace=False)
        c = np.zeros(B.shape[1])
        c[support] = random.choice([-1, 1], 4) * random.uniform(1, 2, 4)
        hits += pursuit(B, B @ c) == set(support.tolist())
    return hits / trials


def coherence(B):
    B = B / np.linalg.norm(B, axis=0)
    return np.abs(B.T @ B - np.eye(B.shape[1])).max()


widths = (0.01, 0.02, 0.03, 0.05)
rows = np.random.default_rng(0).choice(n, 30, replace=False)
shares = {"rows of $r$": [], "rows of $D^{-1} r$": [], "rows of $r$, UNTF": []}
overlap, framed = [], []
for width in widths:
    bumps = np.exp(-((x[:, None] - np.linspace(0.02, 0.98, 60)) / width) ** 2 / 2)
    B = D[rows] @ bumps
    P = UnitNormTightFrame().build(B)
    overlap.append(coherence(bumps))
    framed.append(coherence(P @ B))
    for values, matrix in zip(shares.values(), (B, bumps[rows], P @ B), strict=True):
        values.append(found_by(matrix))

fig, ax = plt.subplots(figsize=(7, 3.2), layout="constrained")
for (name, values), mark in zip(shares.items(), "ovs", strict=True):
    ax.plot(widths, values, mark + "-", label=name)
ax.set(xlabel="width of the bumps", ylabel="supports found", ylim=(0, 1),
       title="Share of states whose 4 of 60 atoms are found from 30 rows")
ax.legend()
plt.show()

# %%
# * **Wide bumps overlap**, and plain selection gets worse with their width. The derivatives in D
#   tell neighbours apart a little better than :math:`D^{-1} r` does, whose columns are the bumps
#   themselves: what is good for accuracy is not what is good for selection.
# * **A unit-norm tight frame (UNTF) helps there.** It multiplies B by a square matrix P so that the
#   columns of P B spread as evenly as they can. Of the widest bumps more than twice as many
#   supports are found.
# * **It does not help where rows miss atoms.** Narrow bumps hardly overlap; they are lost because
#   few or none of the 30 rows see them. No P makes up for equations that were not sampled; here it
#   even does harm. Draw more rows.
# * **It does nothing where nothing is selected.** P is invertible: what solves :math:`B c = b`
#   solves :math:`P B c = P b`. With all atoms active and more rows than atoms, as in the first
#   half of this page, a UNTF does not even exist, since it needs at least as many atoms as rows.
#
# In short
# --------
#
# Start with POD atoms, all of them active, and rows of :math:`D^{-1} r`; that is what ``sparse``
# does when nothing else is said, and its accuracy is then near to Galerkin's. Its merit is the cost
# of nonlinear terms. Selection pays where a dictionary has far more atoms than one state needs;
# coherence is then what to look at, and a tight frame is worth a try.
# Next: :doc:`which method </methods>`.

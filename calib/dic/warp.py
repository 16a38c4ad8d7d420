"""The shape function as a map of the subset: composition with the inverse of an increment."""

from __future__ import annotations

import numpy as np

from fe.compiled import kernel


@kernel(nogil=True, error_model="numpy")
def compose_inverse(p, d):  # type: ignore[no-untyped-def]
    """Parameters of W(p) after the inverse of W(d), in place of p (12,), to second order.

    Terms above the second power of the offset are left out: they vanish with d, so that they
    change the way to the minimum only. Returns False where the increment has no inverse.
    """
    m00, m01, m10, m11 = 1.0 + d[2], d[3], d[4], 1.0 + d[5]
    determinant = m00 * m11 - m01 * m10
    if not determinant > 1e-3:
        return False
    # xi' = c + L xi + r(xi)/2 with L = M^-1, c = -L a, r = -L q
    l00, l01, l10, l11 = (
        m11 / determinant,
        -m01 / determinant,
        -m10 / determinant,
        m00 / determinant,
    )
    c0, c1 = -(l00 * d[0] + l01 * d[1]), -(l10 * d[0] + l11 * d[1])
    new = np.empty(12)
    for k in range(2):
        g0, g1 = p[2 + 2 * k], p[3 + 2 * k]
        if k == 0:
            g0 += 1.0
        else:
            g1 += 1.0
        qaa, qab, qbb = p[6 + 3 * k], p[7 + 3 * k], p[8 + 3 * k]
        # slope of W at c
        s0, s1 = g0 + qaa * c0 + qab * c1, g1 + qab * c0 + qbb * c1
        new[k] = p[k] + g0 * c0 + g1 * c1 + 0.5 * (qaa * c0 * c0 + qbb * c1 * c1) + qab * c0 * c1
        new[2 + 2 * k] = s0 * l00 + s1 * l10
        new[3 + 2 * k] = s0 * l01 + s1 * l11
        for j in range(3):
            bent = -(
                s0 * (l00 * d[6 + j] + l01 * d[9 + j]) + s1 * (l10 * d[6 + j] + l11 * d[9 + j])
            )
            if j == 0:
                turned = qaa * l00 * l00 + 2 * qab * l00 * l10 + qbb * l10 * l10
            elif j == 1:
                turned = qaa * l00 * l01 + qab * (l00 * l11 + l01 * l10) + qbb * l10 * l11
            else:
                turned = qaa * l01 * l01 + 2 * qab * l01 * l11 + qbb * l11 * l11
            new[6 + 3 * k + j] = bent + turned
    new[2] -= 1.0
    new[5] -= 1.0
    p[:] = new
    return True

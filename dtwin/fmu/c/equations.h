/* The equations of motion of the arm for one kind of number, as in dtwin/twin/dynamics.py and in the same order of
 * operations: K u = M(q) q'' + h(q, q') + g(q) + D q' + mu tanh(q'/width).
 *
 * Included twice: with NUMBER double, and with NUMBER double complex, which gives the exact derivatives by a complex
 * step (Squire and Trapp, SIAM Review 40, 1998). E(name) is the name of a function for the kind, REAL(x) its value.
 */

/* The constants of the equations: second moments, couplings of the links, moments of the weights, K, D and mu. */
struct E(coefficients) {
    NUMBER J1, J2, J3, A, B, E, G1, G2, G3;
    NUMBER K[3], D[3], mu[3];
};

static struct E(coefficients) E(coefficients_of)(const NUMBER *p, NUMBER payload, bool weight_only)
{
    const NUMBER m1 = p[3], m2 = p[4], m3 = p[5], l1 = p[9], l2 = p[10], l3 = p[11];
    const NUMBER c1 = p[12], c2 = p[13], c3 = p[14];
    const NUMBER inertial = weight_only ? 0.0 : payload;
    const NUMBER z2 = m2 * c2 + (m3 + inertial) * l2;
    const NUMBER z3 = m3 * c3 + inertial * l3;
    struct E(coefficients) arm;
    int i;
    arm.J1 = p[6] + m1 * c1 * c1 + (m2 + m3 + inertial) * l1 * l1;
    arm.J2 = p[7] + m2 * c2 * c2 + (m3 + inertial) * l2 * l2;
    arm.J3 = p[8] + m3 * c3 * c3 + inertial * l3 * l3;
    arm.A = l1 * z2;
    arm.B = l1 * z3;
    arm.E = l2 * z3;
    arm.G1 = GRAVITY * (m1 * c1 + (m2 + m3 + payload) * l1);
    arm.G2 = GRAVITY * (m2 * c2 + (m3 + payload) * l2);
    arm.G3 = GRAVITY * (m3 * c3 + payload * l3);
    for (i = 0; i < 3; ++i) {
        arm.K[i] = p[i];
        arm.D[i] = p[15 + i];
        arm.mu[i] = p[18 + i];
    }
    return arm;
}

static NUMBER E(clipped)(NUMBER volts)
{
    if (REAL(volts) > VOLTAGE_LIMIT) {
        return VOLTAGE_LIMIT;
    }
    return REAL(volts) < -VOLTAGE_LIMIT ? -VOLTAGE_LIMIT : volts;
}

static NUMBER E(friction)(const struct E(coefficients) *arm, int i, NUMBER w, NUMBER width)
{
    return arm->D[i] * w + (arm->mu[i] != 0.0 ? arm->mu[i] * tanh(w / width) : 0.0);
}

/* The accelerations a (3) from the state x (6), angles then velocities, and the torques of the motors (3). */
static void E(accelerate)(const struct E(coefficients) *arm, const NUMBER *x, const NUMBER *torque, NUMBER width,
                          NUMBER *a)
{
    const NUMBER w1 = x[3], w2 = x[4], w3 = x[5];
    NUMBER s1, c1, s2, c2, s3, c3;
    E(sine_cosine)(x[0], &s1, &c1);
    E(sine_cosine)(x[1], &s2, &c2);
    E(sine_cosine)(x[2], &s3, &c3);
    const NUMBER s23 = s2 * c3 + c2 * s3, c23 = c2 * c3 - s2 * s3;
    const NUMBER c12 = c1 * c2 - s1 * s2, c123 = c1 * c23 - s1 * s23;
    /* centrifugal and Coriolis torques */
    const NUMBER sA = arm->A * s2, sB = arm->B * s23, sE = arm->E * s3;
    const NUMBER ha = sA + sB, hb = sB + sE;
    const NUMBER w12 = w1 * w2, w13_23 = (w1 + w2) * w3;
    const NUMBER h1 = -ha * (w2 * w2 + 2.0 * w12) - hb * (w3 * w3 + 2.0 * w13_23);
    const NUMBER h2 = ha * w1 * w1 - sE * (w3 * w3 + 2.0 * w13_23);
    const NUMBER h3 = hb * w1 * w1 + sE * (w2 * w2 + 2.0 * w12);
    /* gravity */
    const NUMBER g3 = arm->G3 * c123;
    const NUMBER g2 = g3 + arm->G2 * c12;
    const NUMBER g1 = g2 + arm->G1 * c1;
    /* the mass matrix */
    const NUMBER cA = arm->A * c2, cB = arm->B * c23, cE = arm->E * c3;
    const NUMBER M32 = arm->J3 + cE;
    const NUMBER M31 = M32 + cB;
    const NUMBER M22 = arm->J2 + arm->J3 + 2.0 * cE;
    const NUMBER M21 = M22 + cA + cB;
    const NUMBER M11 = arm->J1 + arm->J2 + arm->J3 + 2.0 * (cA + cB + cE);
    /* M a = r by M = L diag(d) L^T from the last row up */
    const NUMBER per_d3 = 1.0 / arm->J3;
    const NUMBER L31 = M31 * per_d3, L32 = M32 * per_d3;
    const NUMBER d2 = M22 - L32 * M32;
    const NUMBER u21 = M21 - L31 * M32;
    const NUMBER per_d2 = 1.0 / d2;
    const NUMBER L21 = u21 * per_d2;
    const NUMBER d1 = (M11 - L31 * M31) - L21 * u21;
    NUMBER r1 = torque[0] - h1 - g1 - E(friction)(arm, 0, w1, width);
    NUMBER r2 = torque[1] - h2 - g2 - E(friction)(arm, 1, w2, width);
    const NUMBER r3 = torque[2] - h3 - g3 - E(friction)(arm, 2, w3, width);
    r2 -= L32 * r3;
    r1 = (r1 - L31 * r3) - L21 * r2;
    a[0] = r1 / d1;
    a[1] = r2 * per_d2 - L21 * a[0];
    a[2] = (r3 * per_d3 - L31 * a[0]) - L32 * a[1];
}

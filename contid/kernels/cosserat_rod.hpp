// Statics of a pneumatic rod: one sweep from base to tip, with derivatives.
//
// Twin of contid/models/cosserat/{section,statics}.py, which is its specification and holds the equations.
// Units: mm, N, N*mm, bar. C++17, no allocation, no exceptions, no dependence on libm where a series will do
// (the same digits on every machine). Columns of derivatives lie next to each other, so loops vectorise.
#pragma once

#include <cmath>

namespace contid {

struct Vec {
    double x, y, z;
};

inline Vec operator+(Vec a, Vec b) { return {a.x + b.x, a.y + b.y, a.z + b.z}; }
inline Vec operator-(Vec a, Vec b) { return {a.x - b.x, a.y - b.y, a.z - b.z}; }
inline Vec operator*(double s, Vec a) { return {s * a.x, s * a.y, s * a.z}; }
inline double dot(Vec a, Vec b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
inline Vec cross(Vec a, Vec b) {
    return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}
inline double norm(Vec a) { return std::sqrt(dot(a, a)); }

struct Mat {
    double m[3][3];
};

inline Mat identity() { return {{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}}; }
inline Vec column(const Mat &a, int j) { return {a.m[0][j], a.m[1][j], a.m[2][j]}; }
inline Vec operator*(const Mat &a, Vec v) {
    return {a.m[0][0] * v.x + a.m[0][1] * v.y + a.m[0][2] * v.z, a.m[1][0] * v.x + a.m[1][1] * v.y + a.m[1][2] * v.z,
            a.m[2][0] * v.x + a.m[2][1] * v.y + a.m[2][2] * v.z};
}
inline Vec transposed_times(const Mat &a, Vec v) {
    return {a.m[0][0] * v.x + a.m[1][0] * v.y + a.m[2][0] * v.z, a.m[0][1] * v.x + a.m[1][1] * v.y + a.m[2][1] * v.z,
            a.m[0][2] * v.x + a.m[1][2] * v.y + a.m[2][2] * v.z};
}
inline Mat operator*(const Mat &a, const Mat &b) {
    Mat c;
    for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j)
            c.m[i][j] = a.m[i][0] * b.m[0][j] + a.m[i][1] * b.m[1][j] + a.m[i][2] * b.m[2][j];
    return c;
}

// Inverse by cofactors; false for a singular matrix.
inline bool inverse(const Mat &a, Mat &out) {
    const auto &m = a.m;
    const double c0 = m[1][1] * m[2][2] - m[1][2] * m[2][1], c1 = m[1][2] * m[2][0] - m[1][0] * m[2][2],
                 c2 = m[1][0] * m[2][1] - m[1][1] * m[2][0];
    const double det = m[0][0] * c0 + m[0][1] * c1 + m[0][2] * c2;
    if (!(std::fabs(det) > 1e-300)) return false;
    const double d = 1.0 / det;
    out = {{{d * c0, d * (m[0][2] * m[2][1] - m[0][1] * m[2][2]), d * (m[0][1] * m[1][2] - m[0][2] * m[1][1])},
            {d * c1, d * (m[0][0] * m[2][2] - m[0][2] * m[2][0]), d * (m[0][2] * m[1][0] - m[0][0] * m[1][2])},
            {d * c2, d * (m[0][1] * m[2][0] - m[0][0] * m[2][1]), d * (m[0][0] * m[1][1] - m[0][1] * m[1][0])}}};
    return true;
}

// Constants of one section; see section.py.
struct Section {
    double length, link, area, inertia, torsion, pair_force, modulus[5], modulus_up_to;
    double pair_moment[2][3];  // about x and y, one column a pair
    Vec weight, link_weight;   // per length
};

// A section at given pressures; see section.Inflated.
struct Inflated {
    double bend, twist, shear, axial, strain, curvature_x, curvature_y, strain_per_bar, softening;
    double per_bar_x[3], per_bar_y[3];
};

inline double modulus(const Section &s, double average, double &slope) {
    const double x = std::fmin(std::fmax(average, 0.0), s.modulus_up_to);
    const double *b = s.modulus;
    const bool inside = average >= 0.0 && average < s.modulus_up_to;
    slope = inside ? 1e-6 * (((4.0 * b[0] * x + 3.0 * b[1]) * x + 2.0 * b[2]) * x + b[3]) : 0.0;
    return 1e-6 * ((((b[0] * x + b[1]) * x + b[2]) * x + b[3]) * x + b[4]);
}

inline Inflated inflate(const Section &s, const double *p) {
    const double sum = p[0] + p[1] + p[2];
    double slope;
    const double e = modulus(s, sum / 3.0, slope);
    Inflated f;
    f.bend = 1.0 / (e * s.inertia);
    f.axial = 1.0 / (e * s.area);
    f.twist = 3.0 / (e * s.torsion);
    f.shear = 3.0 * f.axial;
    f.strain_per_bar = s.pair_force * f.axial;
    f.strain = f.strain_per_bar * sum;
    f.softening = -slope / (3.0 * e);
    f.curvature_x = f.curvature_y = 0.0;
    for (int k = 0; k < 3; ++k) {
        f.per_bar_x[k] = f.bend * s.pair_moment[0][k];
        f.per_bar_y[k] = f.bend * s.pair_moment[1][k];
        f.curvature_x += f.per_bar_x[k] * p[k];
        f.curvature_y += f.per_bar_y[k] * p[k];
    }
    return f;
}

// exp of the screw (u, v): rotation and shift.
inline void screw(Vec u, Vec v, Mat &rotation, Vec &shift) {
    const double t2 = dot(u, u);
    double b, c;
    if (t2 < 1.0) {  // remainder below 1e-18
        b = 0.5 * (1 - t2 / 12 * (1 - t2 / 30 * (1 - t2 / 56 * (1 - t2 / 90 * (1 - t2 / 132 * (1 - t2 / 182 *
            (1 - t2 / 240 * (1 - t2 / 306))))))));
        c = (1 - t2 / 20 * (1 - t2 / 42 * (1 - t2 / 72 * (1 - t2 / 110 * (1 - t2 / 156 * (1 - t2 / 210 *
            (1 - t2 / 272 * (1 - t2 / 342)))))))) / 6.0;
    } else {
        const double t = std::sqrt(t2);
        b = (1.0 - std::cos(t)) / t2;
        c = (1.0 - std::sin(t) / t) / t2;
    }
    const double a = 1.0 - t2 * c;
    const double d = 1.0 - b * t2;  // cos t
    rotation = {{{d + b * u.x * u.x, b * u.x * u.y - a * u.z, b * u.x * u.z + a * u.y},
                 {b * u.y * u.x + a * u.z, d + b * u.y * u.y, b * u.y * u.z - a * u.x},
                 {b * u.z * u.x - a * u.y, b * u.z * u.y + a * u.x, d + b * u.z * u.z}}};
    const Vec uv = cross(u, v);
    shift = v + b * uv + c * cross(u, uv);
}

constexpr int padded(int columns) { return (columns + 1) / 2 * 2; }

// Derivatives by column: turn of the frame, shift of the position, change of mu.
template <int C> struct Columns {
    double turn[3][C], shift[3][C], dmu[3][C];
};

template <int C> struct State {
    Mat R;
    Vec p, mu;
    Columns<C> by;
};

template <int C> void clear(Columns<C> &c) { c = {}; }

// out = a x columns, for `active` columns.
template <int C> inline void add_cross(Vec a, const double (&in)[3][C], double (&out)[3][C], int active) {
    for (int j = 0; j < active; ++j) {
        const double x = in[0][j], y = in[1][j], z = in[2][j];
        out[0][j] += a.y * z - a.z * y;
        out[1][j] += a.z * x - a.x * z;
        out[2][j] += a.x * y - a.y * x;
    }
}

template <int C> inline void times(const Mat &a, const double (&in)[3][C], double (&out)[3][C], int active) {
    for (int i = 0; i < 3; ++i) {
        const double a0 = a.m[i][0], a1 = a.m[i][1], a2 = a.m[i][2];
        for (int j = 0; j < active; ++j) out[i][j] = a0 * in[0][j] + a1 * in[1][j] + a2 * in[2][j];
    }
}

template <int C> inline void add_times(const Mat &a, const double (&in)[3][C], double (&out)[3][C], int active) {
    for (int i = 0; i < 3; ++i) {
        const double a0 = a.m[i][0], a1 = a.m[i][1], a2 = a.m[i][2];
        for (int j = 0; j < active; ++j) out[i][j] += a0 * in[0][j] + a1 * in[1][j] + a2 * in[2][j];
    }
}

inline Mat hat(Vec a) { return {{{0, -a.z, a.y}, {a.z, 0, -a.x}, {-a.y, a.x, 0}}}; }

// Rates of the columns at one stage; statics._tangent_rates. `own` is the first column of this section's
// pressures, -1 for none. dmu moves only under a distributed load.
template <int C>
inline void column_rates(const Inflated &s, const Mat &R, const Columns<C> &at, Vec u, Vec v, Vec N, Vec M, Vec f,
                         bool weighs, int own, int active, Columns<C> &rate) {
    const Vec e = column(R, 2), V = R * v;
    // R diag(bend, bend, twist) R^T and the same for the shift, as matrices: every column is then 3x3 products.
    Mat bend, give;
    const double ev[3] = {e.x, e.y, e.z};
    for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j) {
            bend.m[i][j] = (s.twist - s.bend) * ev[i] * ev[j] + (i == j ? s.bend : 0.0);
            give.m[i][j] = (s.axial - s.shear) * ev[i] * ev[j] + (i == j ? s.shear : 0.0);
        }
    const Mat by_shift = bend * hat(N), by_turn = bend * hat(M);
    Mat pull = give * hat(N);
    const Mat lever = hat(V);
    for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j) pull.m[i][j] -= lever.m[i][j];
    times(bend, at.dmu, rate.turn, active);
    add_times(by_shift, at.shift, rate.turn, active);
    add_times(by_turn, at.turn, rate.turn, active);
    times(pull, at.turn, rate.shift, active);
    if (weighs) {
        for (int i = 0; i < 3; ++i)
            for (int j = 0; j < active; ++j) rate.dmu[i][j] = 0.0;
        add_cross(f, at.shift, rate.dmu, active);
    }
    if (own >= 0) {
        const Vec soft_turn = s.softening * (R * u), soft_shift = s.strain_per_bar * e + s.softening * (V - e);
        const Vec ex = column(R, 0), ey = column(R, 1);
        for (int k = 0; k < 3; ++k) {
            const Vec turn = s.per_bar_x[k] * ex + s.per_bar_y[k] * ey + soft_turn;
            rate.turn[0][own + k] += turn.x;
            rate.turn[1][own + k] += turn.y;
            rate.turn[2][own + k] += turn.z;
            rate.shift[0][own + k] += soft_shift.x;
            rate.shift[1][own + k] += soft_shift.y;
            rate.shift[2][own + k] += soft_shift.z;
        }
    }
}

template <int C>
inline void ahead(const Columns<C> &from, const Columns<C> &rate, double h, bool weighs, int active, Columns<C> &to) {
    for (int i = 0; i < 3; ++i) {
        for (int j = 0; j < active; ++j) to.turn[i][j] = from.turn[i][j] + h * rate.turn[i][j];
        for (int j = 0; j < active; ++j) to.shift[i][j] = from.shift[i][j] + h * rate.shift[i][j];
        if (weighs)
            for (int j = 0; j < active; ++j) to.dmu[i][j] = from.dmu[i][j] + h * rate.dmu[i][j];
    }
}

// One element of reference length h; statics.step. N is the force at its start.
template <int C, bool Tangents>
inline void step(const Inflated &s, State<C> &state, Vec N, Vec f, bool weighs, double h, int own, int active) {
    Vec u[4], v[4], rate_mu[4];
    Mat R = state.R, half_R = state.R;
    Vec p = state.p, half_p = state.p, mu = state.mu;
    Columns<C> rate[Tangents ? 4 : 1], at;
    if constexpr (Tangents) at = state.by;
    for (int i = 0; i < 4; ++i) {
        const double c = i == 0 ? 0.0 : i == 3 ? 1.0 : 0.5;
        if (i > 0) {
            Mat turn;
            Vec shift;
            if (i < 3) {
                screw(0.5 * h * u[i - 1], 0.5 * h * v[i - 1], turn, shift);
                R = state.R * turn;
                p = state.p + state.R * shift;
                if (i == 1) half_R = R, half_p = p;
            } else {  // g4 = g2 exp(k3 - k1/2): what makes the scheme free of commutators
                screw(h * (u[2] - 0.5 * u[0]), h * (v[2] - 0.5 * v[0]), turn, shift);
                R = half_R * turn;
                p = half_p + half_R * shift;
            }
            if (weighs) mu = state.mu + c * h * rate_mu[i - 1];
            if constexpr (Tangents) ahead(state.by, rate[i - 1], c * h, weighs, active, at);
        }
        const Vec force = weighs ? N - c * h * f : N;
        const Vec M = mu - cross(p, force);
        const Vec m = transposed_times(R, M), n = transposed_times(R, force);
        u[i] = {s.curvature_x + s.bend * m.x, s.curvature_y + s.bend * m.y, s.twist * m.z};
        v[i] = {s.shear * n.x, s.shear * n.y, 1.0 + s.strain + s.axial * n.z};
        if (weighs) rate_mu[i] = cross(f, p);
        if constexpr (Tangents)
            column_rates(s, R, at, u[i], v[i], force, M, f, weighs, own, active, rate[i]);
    }
    const double k = h / 12.0;
    Mat turn;
    Vec shift;
    screw(k * (3.0 * u[0] + 2.0 * u[1] + 2.0 * u[2] - u[3]), k * (3.0 * v[0] + 2.0 * v[1] + 2.0 * v[2] - v[3]), turn,
          shift);
    state.p = state.p + state.R * shift;
    state.R = state.R * turn;
    screw(k * (3.0 * u[3] + 2.0 * u[1] + 2.0 * u[2] - u[0]), k * (3.0 * v[3] + 2.0 * v[1] + 2.0 * v[2] - v[0]), turn,
          shift);
    state.p = state.p + state.R * shift;
    state.R = state.R * turn;
    if (weighs) state.mu = state.mu + (h / 6.0) * (rate_mu[0] + 2.0 * rate_mu[1] + 2.0 * rate_mu[2] + rate_mu[3]);
    if constexpr (Tangents) {
        const double w = h / 6.0;
        const auto sum = [&](double(&to)[3][C], const double(&a)[3][C], const double(&b)[3][C], const double(&c)[3][C],
                             const double(&d)[3][C]) {
            for (int i = 0; i < 3; ++i)
                for (int j = 0; j < active; ++j) to[i][j] += w * (a[i][j] + 2.0 * b[i][j] + 2.0 * c[i][j] + d[i][j]);
        };
        sum(state.by.turn, rate[0].turn, rate[1].turn, rate[2].turn, rate[3].turn);
        sum(state.by.shift, rate[0].shift, rate[1].shift, rate[2].shift, rate[3].shift);
        if (weighs) sum(state.by.dmu, rate[0].dmu, rate[1].dmu, rate[2].dmu, rate[3].dmu);
    }
}

// A rigid link of constant weight per length; statics.link.
template <int C, bool Tangents> inline void link(State<C> &state, double length, Vec f, int active) {
    const Vec e = column(state.R, 2);
    state.mu = state.mu - length * cross(state.p + 0.5 * length * e, f);
    state.p = state.p + length * e;
    if constexpr (Tangents) {
        for (int j = 0; j < active; ++j) {
            const Vec w{state.by.turn[0][j], state.by.turn[1][j], state.by.turn[2][j]};
            const Vec moved = length * cross(w, e);
            const Vec old{state.by.shift[0][j], state.by.shift[1][j], state.by.shift[2][j]};
            const Vec moment = length * cross(f, old + 0.5 * moved);
            state.by.shift[0][j] += moved.x;
            state.by.shift[1][j] += moved.y;
            state.by.shift[2][j] += moved.z;
            state.by.dmu[0][j] += moment.x;
            state.by.dmu[1][j] += moment.y;
            state.by.dmu[2][j] += moment.z;
        }
    }
}

// Sections from base to tip with their own weight.
template <int K> struct Rod {
    static constexpr int pressures = 3 * K, columns = padded(3 + 3 * K);
    Section sections[K];
    double reach;
};

// Where a sweep ends: frame and position of the tip, end of the first section, moment residual.
struct Ends {
    Mat R;
    Vec p, mid, moment;
};

// Result of a sweep: tip, frame, end of the first section, moment residual, and derivatives of all four.
template <int K> struct Sweep {
    static constexpr int C = Rod<K>::columns;
    State<C> tip;
    Vec mid, moment;
    double mid_shift[3][C], residual[3][C];
    Ends ends() const { return {tip.R, tip.p, mid, moment}; }
};

inline Vec own_weight(const Section &s) { return s.length * s.weight + s.link * s.link_weight; }

// share scales the own weight, for continuation.
template <int K, bool Tangents>
inline void sweep(const Rod<K> &rod, const double *pressures, Vec base_moment, Vec tip_force, double share, int elements,
                  Sweep<K> &out) {
    constexpr int C = Rod<K>::columns;
    State<C> &state = out.tip;
    state.R = identity();
    state.p = {0, 0, 0};
    state.mu = base_moment;
    if constexpr (Tangents) {
        clear(state.by);
        for (int i = 0; i < 3; ++i) state.by.dmu[i][i] = 1.0;
    }
    Vec N = tip_force;
    for (int i = 0; i < K; ++i) N = N + share * own_weight(rod.sections[i]);
    for (int i = 0; i < K; ++i) {
        const Section &section = rod.sections[i];
        const Inflated inflated = inflate(section, pressures + 3 * i);
        const Vec f = share * section.weight;
        const bool weighs = dot(f, f) > 0.0;
        const double h = section.length / elements;
        const int active = padded(6 + 3 * i);
        for (int k = 0; k < elements; ++k) {
            step<C, Tangents>(inflated, state, N, f, weighs, h, 3 + 3 * i, active);
            if (weighs) N = N - h * f;
        }
        if (i == 0) {
            out.mid = state.p;
            if constexpr (Tangents)
                for (int a = 0; a < 3; ++a)
                    for (int j = 0; j < C; ++j) out.mid_shift[a][j] = state.by.shift[a][j];
        }
        if (section.link > 0.0) {
            const Vec lf = share * section.link_weight;
            link<C, Tangents>(state, section.link, lf, active);
            N = N - section.link * lf;
        }
    }
    out.moment = state.mu - cross(state.p, tip_force);
    if constexpr (Tangents) {
        for (int a = 0; a < 3; ++a)
            for (int j = 0; j < C; ++j) out.residual[a][j] = state.by.dmu[a][j];
        add_cross(tip_force, state.by.shift, out.residual, C);
    }
}

}  // namespace contid

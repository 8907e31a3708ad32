// Equilibrium and its stability: twins of contid/models/cosserat/{equilibrium,stability}.py.
#pragma once

#include "cosserat_rod.hpp"

namespace contid {

constexpr double kStatics = 1e-9;  // moment balance that counts as equilibrium [N*mm]
constexpr int kNewtonSteps = 25;

inline bool finite(Vec a) { return std::isfinite(a.x) && std::isfinite(a.y) && std::isfinite(a.z); }

template <int K> Mat by_base_moment(const double (&rows)[3][Rod<K>::columns]) {
    Mat a;
    for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j) a.m[i][j] = rows[i][j];
    return a;
}

// Newton on the base moment at fixed pressures; `out` keeps the sweep with derivatives.
template <int K>
bool newton(const Rod<K> &rod, const double *pressures, Vec &moment, Vec tip_force, double share, int elements,
            Sweep<K> &out) {
    sweep<K, true>(rod, pressures, moment, tip_force, share, elements, out);
    for (int i = 0; i < kNewtonSteps; ++i) {
        const double error = norm(out.moment);
        if (error <= kStatics) return true;
        Mat inv;
        if (!std::isfinite(error) || !inverse(by_base_moment<K>(out.residual), inv)) return false;
        const Vec full = inv * out.moment, from = moment;
        bool better = false;
        for (double fraction = 1.0; fraction > 0.05 && !better; fraction *= 0.5) {
            moment = from - fraction * full;
            sweep<K, true>(rod, pressures, moment, tip_force, share, elements, out);
            better = norm(out.moment) < error;
        }
        if (!better) {
            moment = from;
            sweep<K, true>(rod, pressures, moment, tip_force, share, elements, out);
            return false;
        }
    }
    return norm(out.moment) <= kStatics;
}

// Equilibrium on the branch that grows out of the unloaded shape.
template <int K>
bool equilibrium(const Rod<K> &rod, const double *pressures, Vec tip_force, double share, int elements, Vec &moment,
                 Sweep<K> &out) {
    moment = {0, 0, 0};
    newton<K>(rod, pressures, moment, {0, 0, 0}, 0.0, elements, out);
    Sweep<K> trial;
    double reached = 0.0, step = 0.25;
    while (reached < 1.0 && step > 1e-3) {
        const double goal = std::fmin(1.0, reached + step);
        Vec start = moment + (goal - reached) * cross(out.tip.p, tip_force);
        const bool good = newton<K>(rod, pressures, start, goal * tip_force, goal * share, elements, trial);
        if (good && norm(trial.tip.p - out.tip.p) < 0.3 * rod.reach) {
            moment = start;
            out = trial;
            reached = goal;
            step *= 2.0;
        } else {
            step *= 0.5;
        }
    }
    return reached >= 1.0;
}

// Negative eigenvalues of the symmetric part: all roots of the characteristic polynomial are real, so
// Descartes' count of sign changes is exact.
inline int negative(const Mat &a) {
    const double s01 = 0.5 * (a.m[0][1] + a.m[1][0]), s02 = 0.5 * (a.m[0][2] + a.m[2][0]),
                 s12 = 0.5 * (a.m[1][2] + a.m[2][1]);
    const double x = a.m[0][0], y = a.m[1][1], z = a.m[2][2];
    const double sign[4] = {1.0, x + y + z, x * y - s01 * s01 + x * z - s02 * s02 + y * z - s12 * s12,
                            x * (y * z - s12 * s12) - s01 * (s01 * z - s12 * s02) + s02 * (s01 * s12 - y * s02)};
    int changes = 0;
    double last = 1.0;
    for (int i = 1; i < 4; ++i)
        if (sign[i] != 0.0) {
            changes += (sign[i] > 0.0) != (last > 0.0);
            last = sign[i];
        }
    return changes;
}

template <int C> Mat columns_of(const double (&rows)[3][C], int first) {
    Mat a;
    for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j) a.m[i][j] = rows[i][first + j];
    return a;
}

// Independent virtual motions that lower the energy; 0 means stable.
template <int K>
int unstable_modes(const Rod<K> &rod, const double *pressures, Vec base_moment, Vec tip_force, double share,
                   int elements) {
    State<6> state;
    state.R = identity();
    state.p = {0, 0, 0};
    state.mu = base_moment;
    Vec N = tip_force;
    for (int i = 0; i < K; ++i) N = N + share * own_weight(rod.sections[i]);
    Mat turn{}, moment = identity(), turn_inverse;
    int modes = 0;
    bool first = true;
    for (int i = 0; i < K; ++i) {
        const Section &section = rod.sections[i];
        const Inflated inflated = inflate(section, pressures + 3 * i);
        const Vec f = share * section.weight;
        const bool weighs = dot(f, f) > 0.0;
        const double h = section.length / elements;
        for (int k = 0; k < elements; ++k) {
            // Columns 0..2 continue the fields that start at the base, 3..5 start at this element.
            clear(state.by);
            for (int a = 0; a < 3; ++a) {
                for (int b = 0; b < 3; ++b) {
                    state.by.turn[a][b] = turn.m[a][b];
                    state.by.dmu[a][b] = moment.m[a][b];
                }
                state.by.dmu[a][3 + a] = 1.0;
            }
            step<6, true>(inflated, state, N, f, weighs, h, -1, 6);
            if (weighs) N = N - h * f;
            const Mat next = columns_of<6>(state.by.turn, 0);
            Mat local;
            if (!first) {
                if (!inverse(turn, turn_inverse) || !inverse(columns_of<6>(state.by.turn, 3), local)) return 3 * K;
                modes += negative(local * next * turn_inverse);
            }
            first = false;
            turn = next;
            const Mat shifted = hat(N) * columns_of<6>(state.by.shift, 0);
            moment = columns_of<6>(state.by.dmu, 0);
            for (int a = 0; a < 3; ++a)
                for (int b = 0; b < 3; ++b) moment.m[a][b] += shifted.m[a][b];
        }
        if (section.link > 0.0) {
            const Vec lf = share * section.link_weight;
            clear(state.by);
            for (int a = 0; a < 3; ++a)
                for (int b = 0; b < 3; ++b) {
                    state.by.turn[a][b] = turn.m[a][b];
                    state.by.dmu[a][b] = moment.m[a][b];
                }
            link<6, true>(state, section.link, lf, 6);
            N = N - section.link * lf;
            const Mat shifted = hat(N) * columns_of<6>(state.by.shift, 0);
            moment = columns_of<6>(state.by.dmu, 0);
            for (int a = 0; a < 3; ++a)
                for (int b = 0; b < 3; ++b) moment.m[a][b] += shifted.m[a][b];
        }
    }
    if (!inverse(turn, turn_inverse)) return 3 * K;
    return modes + negative(moment * turn_inverse);
}

// Least factor of the tip force at which the branch from the unloaded shape stops being stable; -1 when it is
// stable up to `most`, 0 when the own weight alone is too much.
template <int K>
double critical_factor(const Rod<K> &rod, const double *pressures, Vec tip_force, double most, int elements) {
    Sweep<K> scratch;
    const auto stable = [&](double factor) {
        Vec moment;
        return equilibrium<K>(rod, pressures, factor * tip_force, 1.0, elements, moment, scratch) &&
               unstable_modes<K>(rod, pressures, moment, factor * tip_force, 1.0, elements) == 0;
    };
    if (stable(most)) return -1.0;
    if (!stable(0.0)) return 0.0;
    double low = 0.0, high = most;
    while (high - low > 1e-3 * high) {
        const double middle = 0.5 * (low + high);
        (stable(middle) ? low : high) = middle;
    }
    return 0.5 * (low + high);
}

}  // namespace contid

// Bounded inverse statics: twin of contid/models/cosserat/solve.py.
//
// It differs in one thing (and leaves the first try to cosserat_track.hpp): derivatives are kept for further steps while these reduce the error tenfold, since a
// sweep without derivatives costs less than half. Where it ends does not depend on that.
#pragma once

#include <algorithm>

#include "box_step.hpp"
#include "cosserat_balance.hpp"

namespace contid {

constexpr double kCentreWeight = 1e-6, kStepTolerance = 1e-9, kFreedomTolerance = 1e-4, kTrustStart = 0.5,
                 kSideways = 0.3;
constexpr double kBalance = 1e-6;  // [N*mm], inside a descent
constexpr int kChords = 3;

struct Task {
    Vec tip, mid, direction;
    bool has_mid, has_direction, full_rotation;
    double length;
    Mat frame;  // twist-free frame of `direction`, for full_rotation
    int rows() const { return 3 + (has_mid ? 3 : 0) + (has_direction ? 3 : 0); }
    int independent() const { return 3 + (has_mid ? 3 : 0) + (has_direction ? (full_rotation ? 3 : 2) : 0); }
};

template <int K> struct Limits {
    double lower[3 * K], upper[3 * K], centre[3 * K];
};

template <int K> struct Outcome {
    double pressures[3 * K];
    Vec moment;
    double residual, statics;
    bool met, optimal;
    int iterations;
    Ends ends;  // of the last sweep
    int modes;  // ways down the energy at the last sweep, -1 when it did not count them
    Mat tip_by_balance;  // how the tip follows the moment balance, for the error estimate
};

// Rotation that takes e3 to d the short way.
inline Mat tilt(Vec d) {
    if (d.z < -1.0 + 1e-12) return {{{1, 0, 0}, {0, -1, 0}, {0, 0, -1}}};
    const double c = 1.0 / (1.0 + d.z);
    return {{{1.0 - c * d.x * d.x, -c * d.x * d.y, d.x}, {-c * d.x * d.y, 1.0 - c * d.y * d.y, d.y}, {-d.x, -d.y, d.z}}};
}

// Quaternion (w >= 0, vector) of the rotation from the wanted to the found frame.
inline double half_turn(const Task &task, const Mat &R, Vec &vector) {
    Mat q{};
    for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j)
            for (int k = 0; k < 3; ++k) q.m[i][j] += R.m[i][k] * task.frame.m[j][k];
    const double w = 0.5 * std::sqrt(std::fmax(0.0, 1.0 + q.m[0][0] + q.m[1][1] + q.m[2][2]));
    const double s = 1.0 / (4.0 * std::fmax(w, 1e-9));
    vector = {s * (q.m[2][1] - q.m[1][2]), s * (q.m[0][2] - q.m[2][0]), s * (q.m[1][0] - q.m[0][1])};
    return w;
}

inline void put(double *r, Vec a) { r[0] = a.x, r[1] = a.y, r[2] = a.z; }

inline void residual(const Task &task, const Ends &s, double *r) {
    put(r, s.p - task.tip);
    r += 3;
    if (task.has_mid) put(r, s.mid - task.mid), r += 3;
    if (task.has_direction) {
        if (task.full_rotation) {
            Vec vector;
            half_turn(task, s.R, vector);
            put(r, 2.0 * task.length * vector);
        } else {
            put(r, task.length * (column(s.R, 2) - task.direction));
        }
    }
}

template <int K, int Base, int C> void jacobian(const Task &task, const Sweep<K, Base> &s, double (&J)[9][C]) {
    for (int i = 0; i < 3; ++i)
        for (int j = 0; j < C; ++j) J[i][j] = s.tip.by.shift[i][j];
    int row = 3;
    if (task.has_mid) {
        for (int i = 0; i < 3; ++i)
            for (int j = 0; j < C; ++j) J[row + i][j] = s.mid_shift[i][j];
        row += 3;
    }
    if (task.has_direction) {
        Mat by_turn;
        if (task.full_rotation) {
            Vec vector;
            const double w = half_turn(task, s.tip.R, vector);
            by_turn = hat(-1.0 * vector);
            for (int i = 0; i < 3; ++i) by_turn.m[i][i] += w;
        } else {
            by_turn = hat(-1.0 * column(s.tip.R, 2));
        }
        for (int i = 0; i < 3; ++i)
            for (int j = 0; j < C; ++j)
                J[row + i][j] = task.length * (by_turn.m[i][0] * s.tip.by.turn[0][j] +
                                               by_turn.m[i][1] * s.tip.by.turn[1][j] +
                                               by_turn.m[i][2] * s.tip.by.turn[2][j]);
    }
}

// One descent from (start, moment).
template <int K>
Outcome<K> solve(const Rod<K> &rod, const Task &task, Vec tip_force, double share, const Limits<K> &limits,
                 const double *start, Vec moment, int elements, double tolerance, int iterations) {
    constexpr int n = 3 * K, C = Sweep<K>::C;
    const int rows = task.rows();
    const double weight = task.independent() < n ? kCentreWeight : 0.0;
    const double none[3] = {0, 0, 0};
    const double reach2 = 0.5 * rod.reach * rod.reach * inflate(rod.sections[0], none).bend;
    const double balance = reach2 * reach2;

    Outcome<K> out{};
    double *p = out.pressures;
    const bool carries = loaded<K>(rod, tip_force);
    out.modes = -1;
    for (int i = 0; i < n; ++i) p[i] = std::min(std::max(start[i], limits.lower[i]), limits.upper[i]);

    const auto square = [](const double *r, int count) {
        double sum = 0.0;
        for (int i = 0; i < count; ++i) sum += r[i] * r[i];
        return sum;
    };
    const auto task_cost = [&](const double *r, Vec e) { return square(r, rows) + balance * dot(e, e); };
    const auto distance = [&](const double *at) {
        double away = 0.0;
        if (weight > 0.0)
            for (int i = 0; i < n; ++i) away += (at[i] - limits.centre[i]) * (at[i] - limits.centre[i]);
        return weight * away;
    };

    Sweep<K> here, scratch;
    sweep<K, true>(rod, p, moment, tip_force, share, elements, here);
    double r[9], J[9][C], reduced[9][n], along_e[9], H[n][n], g[n], low[n], high[n], d[n], G[3][n];
    Mat inverse_A;
    out.ends = here.ends();
    residual(task, out.ends, r);
    double cost = task_cost(r, out.ends.moment), away = distance(p), trust = kTrustStart, damping = 1.0;
    Vec e = out.ends.moment;
    bool fresh = true;  // derivatives belong to the present point
    bool factored = false;
    int chords = 0;
    while (out.iterations < iterations) {
        if (!factored) {
            ++out.iterations;
            jacobian(task, here, J);
            if (!inverse(first_columns(here.residual), inverse_A)) break;
            for (int i = 0; i < 3; ++i)
                for (int j = 0; j < n; ++j)
                    G[i][j] = inverse_A.m[i][0] * here.residual[0][3 + j] + inverse_A.m[i][1] * here.residual[1][3 + j] +
                              inverse_A.m[i][2] * here.residual[2][3 + j];
            double trace = 0.0;
            for (int a = 0; a < rows; ++a)
                for (int j = 0; j < n; ++j)
                    reduced[a][j] = J[a][3 + j] - J[a][0] * G[0][j] - J[a][1] * G[1][j] - J[a][2] * G[2][j];
            for (int i = 0; i < n; ++i)
                for (int j = 0; j <= i; ++j) {
                    double sum = 0.0;
                    for (int a = 0; a < rows; ++a) sum += reduced[a][i] * reduced[a][j];
                    H[i][j] = H[j][i] = sum;
                    if (i == j) trace += sum;
                }
            for (int i = 0; i < n; ++i) H[i][i] += weight + 1e-13 * trace;
            out.tip_by_balance = first_columns(here.tip.by.shift) * inverse_A;
            factored = true;
        }
        // The secondary goal converges linearly where the task is strongly curved; the second half of the
        // iterations therefore belongs to the task alone.
        const double pull = out.iterations <= iterations / 2 ? weight : 0.0;
        const Vec Ge = inverse_A * e;
        for (int a = 0; a < rows; ++a)
            along_e[a] = r[a] - damping * (J[a][0] * Ge.x + J[a][1] * Ge.y + J[a][2] * Ge.z);
        for (int j = 0; j < n; ++j) {
            g[j] = pull * (p[j] - limits.centre[j]);
            for (int a = 0; a < rows; ++a) g[j] += reduced[a][j] * along_e[a];
            low[j] = std::max(limits.lower[j] - p[j], -trust);
            high[j] = std::min(limits.upper[j] - p[j], trust);
        }
        box_step<n>(H, g, low, high, d);
        double size = 0.0;
        for (int j = 0; j < n; ++j) size = std::fmax(size, std::fabs(d[j]));
        const double error2 = square(r, rows);
        const bool balanced = norm(e) <= kBalance, good = error2 <= tolerance * tolerance;
        if (balanced && good && (pull == 0.0 || size <= kFreedomTolerance)) {
            out.optimal = true;
            break;
        }
        if (balanced && size <= kStepTolerance) {
            double predicted[9];
            for (int a = 0; a < rows; ++a) {
                predicted[a] = along_e[a];
                for (int j = 0; j < n; ++j) predicted[a] += reduced[a][j] * d[j];
            }
            if (square(predicted, rows) > 0.25 * error2) {
                if (fresh) {
                    out.optimal = true;
                    break;
                }
                sweep<K, true>(rod, p, moment, tip_force, share, elements, here);
                fresh = true, factored = false, chords = 0;
                continue;
            }
        }
        double next[n];
        for (int j = 0; j < n; ++j) next[j] = std::min(std::max(p[j] + d[j], limits.lower[j]), limits.upper[j]);
        Vec turn = damping * Ge;
        for (int j = 0; j < n; ++j) turn = turn + d[j] * Vec{G[0][j], G[1][j], G[2][j]};
        const Vec next_moment = moment - turn;
        Ends trial;
        int modes = -1;
        if (carries && chords > 0) {
            // Most likely the last one: its count of unstable modes is then at hand.
            modes = count_modes<K>(rod, next, next_moment, tip_force, share, elements, trial, out.tip_by_balance);
        } else {
            sweep<K, false>(rod, next, next_moment, tip_force, share, elements, scratch);
            trial = scratch.ends();
        }
        double next_r[9];
        residual(task, trial, next_r);
        const double next_cost = task_cost(next_r, trial.moment), next_away = distance(next);
        // Along the freedom the task leaves, a straight step costs task error until the next one mends it.
        const bool sideways = pull > 0.0 && next_cost <= kSideways * kSideways && next_away < away;
        const bool better = next_cost + next_away < cost + away || (pull < weight && next_cost < cost);
        if (better || sideways || (size < 1e-6 && next_cost < cost + 1e-14)) {
            std::copy(next, next + n, p);
            std::copy(next_r, next_r + rows, r);
            moment = next_moment;
            e = trial.moment;
            out.ends = trial;
            out.modes = modes;
            const bool well = next_cost < 0.01 * cost;
            if (sideways || next_cost < 0.5 * cost) trust *= 2.0;
            cost = next_cost;
            away = next_away;
            damping = std::fmin(1.0, 2.0 * damping);
            fresh = false;
            const bool done = norm(e) <= kBalance && square(r, rows) <= tolerance * tolerance;
            if (done && weight == 0.0) {
                out.optimal = true;
                break;
            }
            if ((done || well) && ++chords <= kChords) continue;
            sweep<K, true>(rod, p, moment, tip_force, share, elements, here);
            fresh = true, factored = false, chords = 0;
        } else if (!fresh) {
            sweep<K, true>(rod, p, moment, tip_force, share, elements, here);
            fresh = true, factored = false, chords = 0;
        } else {
            trust = 0.3 * std::min(trust, std::max(size, 1e-12));
            damping *= 0.5;
            if (trust < 1e-12) break;
        }
    }
    out.statics = norm(e);
    out.residual = std::sqrt(square(r, rows));
    out.met = out.residual <= tolerance && out.statics <= kBalance;
    if (!out.met) {
        newton<K>(rod, p, moment, tip_force, share, elements, here);
        out.ends = here.ends();
        out.modes = -1;
        residual(task, out.ends, r);
        out.statics = norm(here.moment);
        out.residual = std::sqrt(square(r, rows));
        out.met = out.residual <= tolerance && out.statics <= kBalance;
    }
    out.moment = moment;
    out.optimal = out.optimal || out.met;
    return out;
}

}  // namespace contid

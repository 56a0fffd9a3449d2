// Gaussians carried by particles, p = sum_i w_i (x_i + F_i (p0 - x0_i)), C = A C0 A^T with A = sum_i w_i F_i, and the
// adjoint: one thread a point and frame on CUDA; on the CPU each thread has frames of its own, so nothing collides.
#pragma once

namespace physreal {

// Every member is a word of 8 bytes; carrying.py fills them in this order.
template <class S> struct Carrying {
  long long frames, points, particles, count, threads;  // `count` particles a point
  const int* neighbours;                                // [points, count]
  const S *weights, *x0, *points0,
      *covariances0;                     // [points, count], [particles, 3] m, [points, 3] m, [points, 3, 3] m^2
  const S *x, *F;                        // [frames, particles, 3] m, [frames, particles, 3, 3]
  S *means, *covariances;                // [frames, points, 3] m, [frames, points, 3, 3] m^2
  const S *means_bar, *covariances_bar;  // null where none
  S *x_bar, *F_bar;                      // added to
};

// Row r of a times b, both 3x3 in rows.
template <class S> inline void product(const S (&a)[9], const S* b, S (&out)[9]) {
  for (int r = 0; r < 3; ++r)
    for (int c = 0; c < 3; ++c) out[3 * r + c] = a[3 * r] * b[c] + a[3 * r + 1] * b[3 + c] + a[3 * r + 2] * b[6 + c];
}

template <class S> inline void add(S* target, S value) {
#if defined(__CUDA_ARCH__)
  atomicAdd(target, value);
#else
  *target += value;
#endif
}

// visit(weight, particle's place in the frame, p0 - x0) for each of a point's particles.
template <class S, class Visit>
inline void each_neighbour(const Carrying<S>& c, long long frame, long long point, Visit&& visit) {
  const S* p0 = c.points0 + 3 * point;
  for (int k = 0; k < c.count; ++k) {
    const long long i = c.neighbours[point * c.count + k];
    const S offset[3] = {p0[0] - c.x0[3 * i], p0[1] - c.x0[3 * i + 1], p0[2] - c.x0[3 * i + 2]};
    visit(c.weights[point * c.count + k], frame * c.particles + i, offset);
  }
}

template <class S> inline void carry_one(const Carrying<S>& c, long long frame, long long point) {
  S p[3] = {}, A[9] = {};
  each_neighbour(c, frame, point, [&](S w, long long i, const S(&offset)[3]) {
    const S *F = c.F + 9 * i, *x = c.x + 3 * i;
    for (int k = 0; k < 9; ++k) A[k] += w * F[k];
    for (int r = 0; r < 3; ++r)
      p[r] += w * (x[r] + F[3 * r] * offset[0] + F[3 * r + 1] * offset[1] + F[3 * r + 2] * offset[2]);
  });
  const long long out = frame * c.points + point;
  for (int r = 0; r < 3; ++r) c.means[3 * out + r] = p[r];
  S half[9];
  product(A, c.covariances0 + 9 * point, half);
  for (int r = 0; r < 3; ++r)
    for (int k = 0; k < 3; ++k)
      c.covariances[9 * out + 3 * r + k] =
          half[3 * r] * A[3 * k] + half[3 * r + 1] * A[3 * k + 1] + half[3 * r + 2] * A[3 * k + 2];
}

template <class S> inline void carry_one_adjoint(const Carrying<S>& c, long long frame, long long point) {
  const long long in = frame * c.points + point;
  S mean_bar[3] = {}, A_bar[9] = {};
  for (int r = 0; c.means_bar && r < 3; ++r) mean_bar[r] = c.means_bar[3 * in + r];
  if (c.covariances_bar) {
    S A[9] = {}, half[9], both[9];
    each_neighbour(c, frame, point, [&](S w, long long i, const S(&)[3]) {
      for (int k = 0; k < 9; ++k) A[k] += w * c.F[9 * i + k];
    });
    product(A, c.covariances0 + 9 * point, half);
    const S* bar = c.covariances_bar + 9 * in;
    for (int r = 0; r < 3; ++r)
      for (int k = 0; k < 3; ++k) both[3 * r + k] = bar[3 * r + k] + bar[3 * k + r];
    product(both, half, A_bar);
  }
  each_neighbour(c, frame, point, [&](S w, long long i, const S(&offset)[3]) {
    for (int r = 0; r < 3; ++r) {
      add(c.x_bar + 3 * i + r, w * mean_bar[r]);
      for (int k = 0; k < 3; ++k) add(c.F_bar + 9 * i + 3 * r + k, w * (A_bar[3 * r + k] + mean_bar[r] * offset[k]));
    }
  });
}

// visit(frame, point) for what this thread has to do.
template <class S, class Visit> inline void each_of_thread(const Carrying<S>& c, long long thread, Visit&& visit) {
#if defined(__CUDA_ARCH__)
  visit(thread / c.points, thread % c.points);
#else
  for (long long frame = c.frames * thread / c.threads; frame < c.frames * (thread + 1) / c.threads; ++frame)
    for (long long point = 0; point < c.points; ++point) visit(frame, point);
#endif
}

template <class S> inline void carry(const Carrying<S>& c, int thread) {
  each_of_thread(c, thread, [&](long long frame, long long point) { carry_one(c, frame, point); });
}

template <class S> inline void carry_adjoint(const Carrying<S>& c, int thread) {
  each_of_thread(c, thread, [&](long long frame, long long point) { carry_one_adjoint(c, frame, point); });
}

}  // namespace physreal

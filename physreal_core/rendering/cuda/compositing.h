// One block a tile: its threads fetch a batch of Gaussians together, then each draws it into its own pixels.
// The adjoint goes front to back too: `behind` is the loss that all that lies behind the current Gaussian carries, so
// d loss / d alpha = T * (features . bar) - behind / (1 - alpha).
#pragma once

#include "block.h"
#include "numbers.h"
#include "scene.h"

namespace physreal {

constexpr int ROWS =
    2;  // pixels of a thread, one below the other: their parts of a sum need no exchange; 1, 2 and 4 were measured
constexpr int THREADS = TILE * TILE / ROWS;

// A Gaussian in the block's shared memory: what of its splat is drawn.
template <class S> struct alignas(16) Item {
  S x, y, xx, xy, yy, opacity, lowest, unused;
  S features[4];
};

template <class S> struct Batch {
  Item<S> items[THREADS];
  int gaussians[THREADS];
};

template <class S> struct Tile : Corner {
  int first, end;

  Tile(const Scene<S>& s, int index) : Corner(s, index), first(s.starts[index]), end(s.starts[index + 1]) {}

  // The pixel in row r of a thread, or -1 outside the image.
  long long pixel(const Scene<S>& s, int thread, int r) const {
    const long long x = left + thread % TILE, y = top + thread / TILE * ROWS + r;
    return x < s.width && y < s.height ? first_pixel + y * s.width + x : -1;
  }
};

template <class S> inline void fetch(const Scene<S>& s, Batch<S>& batch, int thread, int place, int end) {
  if (place >= end) return;
  const int g = s.lists[place];
  const Splat<S>& p = s.splats[g];
  batch.gaussians[thread] = g;
  batch.items[thread] = {p.x,      p.y,  p.xx,
                         p.xy,     p.yy, p.opacity,
                         p.lowest, S(0), {p.features[0], p.features[1], p.features[2], p.features[3]}};
}

// The rows of one thread: transmittances, and whether any is above its threshold.
template <class S> struct Rays {
  S T[ROWS];

  void start(const Scene<S>& s, const Tile<S>& tile, int thread) {
    for (int r = 0; r < ROWS; ++r) T[r] = tile.pixel(s, thread, r) >= 0 ? S(1) : S(0);
  }

  bool open(S least) const {
    bool open = false;
    for (int r = 0; r < ROWS; ++r) open |= T[r] > least;
    return open;
  }
};

// visit(thread, place of its state, batch, number of its Gaussians) until the rays of the block have ended.
template <class S, class AnyOpen, class Visit>
inline void front_to_back(const Scene<S>& s, const Tile<S>& tile, AnyOpen&& any_open, Visit&& visit) {
  BLOCK_SHARED Batch<S> batch;
  for (int start = tile.first; start < tile.end && any_of_block(any_open()); start += THREADS) {
    const int count = tile.end - start < THREADS ? tile.end - start : THREADS;
    each_thread<THREADS>([&](int thread, int) { fetch(s, batch, thread, start + thread, tile.end); });
    barrier();
    each_thread<THREADS>([&](int thread, int own) { visit(thread, own, batch, count); });
  }
}

template <class S> inline S power_at(const Item<S>& p, S dx, S dy) {
  return dx * (p.xx * dx + p.xy * dy) + p.yy * dy * dy;
}

template <class S> inline void composite(const Scene<S>& s, int index) {
  const Tile<S> tile(s, index);
  struct State {
    Rays<S> rays;
    S total[ROWS][4];
  } states[OWN<THREADS>];
  each_thread<THREADS>([&](int thread, int own) {
    states[own] = {};
    states[own].rays.start(s, tile, thread);
  });
  const auto any_open = [&] {
    bool open = false;
    for (const State& state : states) open |= state.rays.open(s.transmittance_min);
    return open;
  };
  front_to_back(s, tile, any_open, [&](int thread, int own, const Batch<S>& batch, int count) {
    State& state = states[own];
    const S x = S(tile.left + thread % TILE), y = S(tile.top + thread / TILE * ROWS);
    if (!state.rays.open(s.transmittance_min)) return;
    for (int i = 0; i < count; ++i) {
      const Item<S> p = batch.items[i];
#pragma unroll
      for (int r = 0; r < ROWS; ++r) {
        const S power = power_at(p, x - p.x, y + S(r) - p.y), T = state.rays.T[r];
        if (!(power >= p.lowest && T > s.transmittance_min)) continue;
        const S uncapped = p.opacity * exp2_of(power), weight = T * (uncapped < s.alpha_max ? uncapped : s.alpha_max);
        for (int k = 0; k < 4; ++k) state.total[r][k] += weight * p.features[k];
        state.rays.T[r] -= weight;
      }
    }
  });
  each_thread<THREADS>([&](int thread, int own) {
    for (int r = 0; r < ROWS; ++r) {
      const long long pixel = tile.pixel(s, thread, r);
      if (pixel >= 0) write_pixel(s, pixel, states[own].rays.T[r], [&](int k) { return states[own].total[r][k]; });
    }
  });
}

// With Features false only alpha was used.
template <bool Features, class S> inline void composite_adjoint(const Scene<S>& s, int index) {
  const Tile<S> tile(s, index);
  struct State {
    Rays<S> rays;
    S behind[ROWS], bar[ROWS][4];
  } states[OWN<THREADS>];
  each_thread<THREADS>([&](int thread, int own) {
    State& state = states[own];
    state = {};
    state.rays.start(s, tile, thread);
    for (int r = 0; r < ROWS; ++r) {
      const long long pixel = tile.pixel(s, thread, r);
      if (pixel < 0) continue;
      const PixelBar<S> bar(s, pixel);
      state.behind[r] = bar.carried;
      for (int k = 0; Features && k < 4; ++k) state.bar[r][k] = bar.features[k];
    }
  });
  const auto any_open = [&] {
    bool open = false;
    for (const State& state : states) open |= state.rays.open(s.transmittance_min);
    return open;
  };
  front_to_back(s, tile, any_open, [&](int thread, int own, const Batch<S>& batch, int count) {
    State& state = states[own];
    const S x = S(tile.left + thread % TILE), y = S(tile.top + thread / TILE * ROWS);
    if (!any_of_warp(state.rays.open(s.transmittance_min))) return;
    for (int i = 0; i < count; ++i) {
      const Item<S> p = batch.items[i];
      const S dx = x - p.x;
      S power[ROWS];
      bool drawn[ROWS], any = false;
#pragma unroll
      for (int r = 0; r < ROWS; ++r) {
        power[r] = power_at(p, dx, y + S(r) - p.y);
        drawn[r] = power[r] >= p.lowest && state.rays.T[r] > s.transmittance_min;
        any |= drawn[r];
      }
      if (!any_of_warp(any)) continue;
      S sums[16] = {};
#pragma unroll
      for (int r = 0; r < ROWS; ++r) {
        if (!drawn[r]) continue;
        const S dy = y + S(r) - p.y, T = state.rays.T[r];
        const S falloff = exp2_of(power[r]), uncapped = p.opacity * falloff;
        const bool capped = uncapped >= s.alpha_max;
        const S alpha = capped ? s.alpha_max : uncapped, weight = alpha * T;
        S slope = S(0);
        if (Features) {
          S gain = S(0);
          for (int k = 0; k < 4; ++k) {
            gain += p.features[k] * state.bar[r][k];
            sums[FEATURES + k] += weight * state.bar[r][k];
          }
          state.behind[r] -= weight * gain;
          slope = T * gain;
        }
        slope -= quotient(state.behind[r], S(1) - alpha);
        const S q = capped ? S(0) : falloff * slope;
        sums[Q] += q, sums[Q_Y] += q * dy, sums[Q_YY] += q * dy * dy;
        state.rays.T[r] -= weight;
      }
      sums[Q_X] = sums[Q] * dx, sums[Q_XX] = sums[Q_X] * dx, sums[Q_XY] = sums[Q_Y] * dx;
      add_over_warp<USED>(s.moments + (long long)(batch.gaussians[i]) * MOMENTS, sums);
    }
  });
}

template <class S> inline void composite_adjoint(const Scene<S>& s, int index) {
  if (s.rgb_bar || s.depth_bar)
    composite_adjoint<true>(s, index);
  else
    composite_adjoint<false>(s, index);
}

}  // namespace physreal

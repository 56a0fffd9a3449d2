// Projection on the CPU and its adjoint, 16 Gaussians at a time.
#pragma once

#include "lanes.h"
#include "projection.h"

namespace physreal {

// This thread's share of `count` blocks.
struct Share {
  long long first, end;
  Share(long long count, long long thread, long long threads)
      : first(count * thread / threads), end(count * (thread + 1) / threads) {}
};

template <class S> using Batch = Lanes<S, 16>;
constexpr int BATCH = 16;

// Reads a number of 16 successive Gaussians; those past the last repeat it.
template <class S> struct Gather {
  long long first, count;

  Batch<S> operator()(const S* array, int stride, int column) const {
    Batch<S> lanes;
    for (int i = 0; i < BATCH; ++i) lanes[i] = array[(first + i < count ? first + i : count - 1) * stride + column];
    return lanes;
  }
};

// Splats, tile boxes and this thread's number of pairs.
template <class S> void project(const Scene<S>& s, int thread) {
  const Share blocks((s.count + BATCH - 1) / BATCH, thread, s.threads);
  long long pairs = 0;
  for (long long first = blocks.first * BATCH; first < blocks.end * BATCH; first += BATCH) {
    const Gather<S> gather{first, s.count};
    const Projection<S, Batch<S>> p(s, gather);
    const Batch<S> opacity = gather(s.opacities, 1, 0);
    const Outline<S, Batch<S>> o(s, p, opacity);
    const auto drawn = o.drawn(s, p.z, opacity);
    for (int i = 0; i < BATCH && first + i < s.count; ++i) {
      TileBox box = {0, -1, 0, -1};
      if (drawn[i]) {
        s.splats[first + i] = make_splat<S>(o.u[i], o.v[i], o.xx[i], o.xy[i], o.yy[i], o.determinant[i], o.spread[i],
                                            opacity[i], p.z[i], s.colours + 3 * (first + i));
        box = tile_box<S>(o.left[i], o.right[i], o.top[i], o.bottom[i]);
        pairs += (long long)(box.right - box.left + 1) * (box.bottom - box.top + 1);
      }
      s.boxes[first + i] = box;
    }
  }
  s.pairs[thread] = pairs;
}

// Adjoint of `project`, from the moments of all threads. Everything is written, zeros where nothing was drawn.
template <class S> void project_adjoint(const Scene<S>& s, int thread) {
  const Share blocks((s.count + BATCH - 1) / BATCH, thread, s.threads);
  Axis<Batch<S>> axes_bar[3] = {}, centre_bar = {};
  for (long long first = blocks.first * BATCH; first < blocks.end * BATCH; first += BATCH) {
    const int valid = int(s.count - first < BATCH ? s.count - first : BATCH);
    Mask<Lanes<S, BATCH>> drawn = {};
    Batch<S> m[USED] = {}, opacity = {}, K[3] = {};
    for (int i = 0; i < valid; ++i) {
      const TileBox& box = s.boxes[first + i];
      if (box.left > box.right) continue;
      drawn[i] = -1;
      for (int t = 0; t < s.threads; ++t)
        for (int k = 0; k < USED; ++k) m[k][i] += s.moments[(t * s.count + first + i) * MOMENTS + k];
      S inverse[3];
      conic(s.splats[first + i], inverse);
      for (int k = 0; k < 3; ++k) K[k][i] = inverse[k];
      opacity[i] = s.splats[first + i].opacity;
    }
    Batch<S> out[12] = {};  // mean and covariance
    if (any(drawn)) {
      const Projection<S, Batch<S>> p(s, Gather<S>{first, s.count});
      const ProjectionBar<S, Batch<S>> bar(s, p, opacity, K[0], K[1], K[2], m);
      // Lanes that were not drawn may hold anything.
      const auto kept = [&](Batch<S> v) -> Batch<S> { return drawn ? v : Batch<S>(S(0)); };
      const auto kept_axis = [&](const Axis<Batch<S>>& a) -> Axis<Batch<S>> {
        return {kept(a.x), kept(a.y), kept(a.z)};
      };
      const Batch<S> all[12] = {bar.mean.x, bar.mean.y, bar.mean.z, bar.C.xx, bar.C.xy, bar.C.xz,
                                bar.C.xy,   bar.C.yy,   bar.C.yz,   bar.C.xz, bar.C.yz, bar.C.zz};
      for (int k = 0; k < 12; ++k) out[k] = kept(all[k]);
      centre_bar = centre_bar + kept_axis(bar.mean);
      for (int k = 0; k < 3; ++k) axes_bar[k] = axes_bar[k] + kept_axis(bar.axes[k]);
    }
    for (int i = 0; i < valid; ++i) {
      const long long g = first + i;
      for (int k = 0; k < 3; ++k) s.means_bar[3 * g + k] = out[k][i], s.colours_bar[3 * g + k] = m[FEATURES + k][i];
      for (int k = 0; k < 9; ++k) s.covariances_bar[9 * g + k] = out[3 + k][i];
      s.opacities_bar[g] = m[Q][i];
    }
  }
  S* pose_bar = s.pose_bar + 12 * thread;
  for (int k = 0; k < 3; ++k)
    pose_bar[k] = sum(axes_bar[k].x), pose_bar[4 + k] = sum(axes_bar[k].y), pose_bar[8 + k] = sum(axes_bar[k].z);
  pose_bar[3] = -sum(centre_bar.x), pose_bar[7] = -sum(centre_bar.y), pose_bar[11] = -sum(centre_bar.z);
}

}  // namespace physreal

// One thread a Gaussian: projection, the list of its tiles, the projection's adjoint; one a pair: where tiles begin.
#pragma once

#include "block.h"
#include "numbers.h"
#include "projection.h"

namespace physreal {

template <class S> struct Entry {
  long long g;
  S operator()(const S* array, int stride, int column) const { return array[g * stride + column]; }
};

// Whether alpha reaches its threshold in the pixels [left, left + 15] x [top, top + 15]: the power is largest at the
// centre or, with that outside, on a side that faces it.
template <class S> inline bool reaches(const Splat<S>& p, S left, S top) {
  const S x0 = left - p.x, x1 = x0 + S(TILE - 1), y0 = top - p.y, y1 = y0 + S(TILE - 1), none = S(0);
  const S x = clamped(none, x0, x1), y = clamped(none, y0, y1);
  const auto power = [&](S dx, S dy) { return p.xx * dx * dx + p.xy * dx * dy + p.yy * dy * dy; };
  S best = x == none && y == none ? none : power(x, y);
  if (x != none) {
    const S along = power(x, clamped(S(-0.5) * p.xy * x / p.yy, y0, y1));
    best = along > best ? along : best;
  }
  if (y != none) {
    const S along = power(clamped(S(-0.5) * p.xy * y / p.xx, x0, x1), y);
    best = along > best ? along : best;
  }
  return best >= p.lowest * S(1.0001);  // slack for rounding; the pixels are tested themselves
}

// visit(tile) for each tile that the Gaussian reaches.
template <class S, class Visit>
inline void each_tile(const Scene<S>& s, const Splat<S>& p, const TileBox& box, Visit&& visit) {
  for (int y = box.top; y <= box.bottom; ++y)
    for (int x = box.left; x <= box.right; ++x)
      if (reaches(p, S(x * TILE), S(y * TILE))) visit(y * s.tiles_x + x);
}

template <class S> inline void project(const Scene<S>& s, long long g) {
  if (g >= s.count) return;
  const Projection<S, S> p(s, Entry<S>{g});
  const S opacity = s.opacities[g];
  const Outline<S, S> o(s, p, opacity);
  int count = 0;
  if (o.drawn(s, p.z, opacity)) {
    const Splat<S> splat =
        make_splat<S>(o.u, o.v, o.xx, o.xy, o.yy, o.determinant, o.spread, opacity, p.z, s.colours + 3 * g);
    const TileBox box = tile_box<S>(o.left, o.right, o.top, o.bottom);
    each_tile(s, splat, box, [&](int) { ++count; });
    s.splats[g] = splat, s.boxes[g] = box;
  }
  s.counts[g] = count;
}

// A key for each of the Gaussian's tiles: first the tile, then the depth.
template <class S> inline void list_tiles(const Scene<S>& s, long long g) {
  if (g >= s.count || s.counts[g] == 0) return;
  const Splat<S> splat = s.splats[g];
  const unsigned depth = s.ranks ? unsigned(s.ranks[g]) : bits_of(splat.features[3]);
  const unsigned long long first_tile = s.first_tile(g);
  int place = s.ends[g] - s.counts[g];
  each_tile(s, splat, s.boxes[g], [&](int tile) {
    s.pair_keys[place] = (first_tile + tile) << 32 | depth;
    s.lists[place++] = int(g);
  });
}

// From the sorted keys; thread pair_count writes what is left.
template <class S> inline void find_starts(const Scene<S>& s, long long pair) {
  if (pair > s.pair_count) return;
  const long long tiles = s.tiles();
  const long long tile = pair < s.pair_count ? (long long)(s.pair_keys[pair] >> 32) : tiles;
  for (long long t = pair ? (long long)(s.pair_keys[pair - 1] >> 32) + 1 : 0; t <= tile; ++t) s.starts[t] = int(pair);
}

// Whole warps come here: the pose's adjoint is a sum over them.
template <class S> inline void project_adjoint(const Scene<S>& s, long long g) {
  S pose_bar[16] = {};
  if (g < s.count && s.counts[g] > 0) {
    S m[USED], K[3];
    for (int k = 0; k < USED; ++k) m[k] = s.moments[g * MOMENTS + k];
    const Splat<S> splat = s.splats[g];
    conic(splat, K);
    const Projection<S, S> p(s, Entry<S>{g});
    const ProjectionBar<S, S> bar(s, p, splat.opacity, K[0], K[1], K[2], m);
    const S C[9] = {bar.C.xx, bar.C.xy, bar.C.xz, bar.C.xy, bar.C.yy, bar.C.yz, bar.C.xz, bar.C.yz, bar.C.zz};
    const S mean[3] = {bar.mean.x, bar.mean.y, bar.mean.z};
    for (int k = 0; k < 9; ++k) s.covariances_bar[9 * g + k] = C[k];
    for (int k = 0; k < 3; ++k) {
      s.means_bar[3 * g + k] = mean[k], s.colours_bar[3 * g + k] = m[FEATURES + k];
      pose_bar[k] = bar.axes[k].x, pose_bar[4 + k] = bar.axes[k].y, pose_bar[8 + k] = bar.axes[k].z;
      pose_bar[4 * k + 3] = -mean[k];
    }
    s.opacities_bar[g] = m[Q];
  } else if (g < s.count) {
    for (int k = 0; k < 9; ++k) s.covariances_bar[9 * g + k] = S(0);
    for (int k = 0; k < 3; ++k) s.means_bar[3 * g + k] = s.colours_bar[3 * g + k] = S(0);
    s.opacities_bar[g] = S(0);
  }
  if (s.pose_bar) add_over_warp<12>(s.pose_bar, pose_bar);
}

}  // namespace physreal

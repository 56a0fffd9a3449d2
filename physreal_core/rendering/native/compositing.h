// Front-to-back compositing of a tile, row by row, and its adjoint, which goes front to back too: `behind` is the loss
// that all behind the current Gaussian carries, so d loss / d alpha = T * (features . bar) - behind / (1 - alpha).
#pragma once

#include "lanes.h"
#include "scene.h"

namespace physreal {

template <class S> using Row = Lanes<S, TILE>;  // a row of a tile is one set of lanes
template <class S> using RowMask = Mask<Lanes<S, TILE>>;

// One tile of the image: where it lies and which of its pixels are in the image.
template <class S> struct Tile : Corner {
  long long columns, rows;
  const int *first, *end;  // its Gaussians

  Tile(const Scene<S>& s, long long index)
      : Corner(s, index),
        columns(s.width - left < TILE ? s.width - left : TILE),
        rows(s.height - top < TILE ? s.height - top : TILE),
        first(s.lists + s.starts[index]),
        end(s.lists + s.starts[index + 1]) {}

  RowMask<S> inside(int row) const { return (iota<S, TILE>() < S(columns)) & RowMask<S>(row < rows ? -1 : 0); }

  // visit(pixel of the image, row, lane) for every pixel.
  template <class Visit> void each_pixel(const Scene<S>& s, Visit&& visit) const {
    for (int row = 0; row < rows; ++row)
      for (int lane = 0; lane < columns; ++lane) visit(first_pixel + (top + row) * s.width + left + lane, row, lane);
  }

  // Rows in which the Gaussian reaches the tile, a bit each; the slack is for rounding: the pixels are tested too.
  unsigned rows_reached(const Splat<S>& p) const {
    const Row<S> dy = iota<S, TILE>() + (S(top) - p.y), none = S(0);
    const Row<S> middle = p.lean * dy + (p.x - S(left));
    const Row<S> away = max(max(-middle, middle - S(TILE - 1)), none);
    return bits(away * away <= p.reach * S(1.0001) + S(0.001) - p.narrowing * dy * dy);
  }
};

// Rows in which a pixel is not finished yet, a bit each.
template <class S> inline unsigned rows_open(const Row<S> (&transmittance)[TILE], S transmittance_min) {
  unsigned open = 0;
  for (int row = 0; row < TILE; ++row) open |= unsigned(any(transmittance[row] > transmittance_min)) << row;
  return open;
}

// How a Gaussian covers one row; `drawn` is false in finished pixels and where it is too weak.
template <class S> struct Cover {
  Row<S> falloff, alpha, weight;
  RowMask<S> drawn, capped;

  Cover(const Scene<S>& s, const Splat<S>& p, Row<S> dx, Row<S> dx_part, S dy, Row<S> transmittance) {
    const Row<S> power = dx_part + (p.xy * dy) * dx + p.yy * dy * dy, none = S(0), cap = s.alpha_max;
    falloff = exp2_between(power);
    drawn = (power >= p.lowest) & (transmittance > s.transmittance_min);
    const Row<S> uncapped = p.opacity * falloff;
    capped = uncapped >= cap;
    alpha = drawn ? (capped ? cap : uncapped) : none;
    weight = alpha * transmittance;
  }
};

// visit(splat, row, dx, dx_part, dy) for each row that a Gaussian reaches, and then finish(Gaussian, dx).
template <class S, class Visit, class Finish> inline void front_to_back(const Scene<S>& s, const Tile<S>& tile,
                                                                        const Row<S> (&transmittance)[TILE],
                                                                        Visit&& visit, Finish&& finish) {
  constexpr int BETWEEN = 16;  // Gaussians between two looks at which rows are finished
  unsigned open = rows_open<S>(transmittance, s.transmittance_min);
  for (const int* item = tile.first; item < tile.end && open; ++item) {
    if (item + 4 < tile.end) __builtin_prefetch(&s.splats[item[4]]);
    const Splat<S>& p = s.splats[*item];
    const Row<S> dx = iota<S, TILE>() + (S(tile.left) - p.x), dx_part = p.xx * dx * dx;
    unsigned rows = tile.rows_reached(p) & open;
    if (rows) {
      for (; rows; rows &= rows - 1) {
        const int row = __builtin_ctz(rows);
        visit(p, row, dx, dx_part, S(tile.top + row) - p.y);
      }
      finish(*item, dx);
    }
    if ((item - tile.first) % BETWEEN == BETWEEN - 1) open = rows_open<S>(transmittance, s.transmittance_min);
  }
}

template <class S> void composite_tile(const Scene<S>& s, long long index) {
  const Tile<S> tile(s, index);
  Row<S> transmittance[TILE], total[4][TILE] = {};
  for (int row = 0; row < TILE; ++row) transmittance[row] = tile.inside(row) ? Row<S>(S(1)) : Row<S>(S(0));
  front_to_back<S>(
      s, tile, transmittance,
      [&](const Splat<S>& p, int row, Row<S> dx, Row<S> dx_part, S dy) {
        const Cover<S> cover(s, p, dx, dx_part, dy, transmittance[row]);
        for (int k = 0; k < 4; ++k) total[k][row] += cover.weight * p.features[k];
        transmittance[row] -= cover.weight;
      },
      [](int, Row<S>) {});
  tile.each_pixel(s, [&](long long pixel, int row, int lane) {
    write_pixel(s, pixel, S(transmittance[row][lane]), [&](int k) { return total[k][row][lane]; });
  });
}

// All of the loss by what the tile shows; with Features false only alpha was used.
template <class S, bool Features> void composite_tile_adjoint(const Scene<S>& s, long long index, S* moments) {
  const Tile<S> tile(s, index);
  if (tile.first == tile.end) return;
  Row<S> transmittance[TILE], behind[TILE] = {}, bar[4][TILE] = {};
  for (int row = 0; row < TILE; ++row) transmittance[row] = tile.inside(row) ? Row<S>(S(1)) : Row<S>(S(0));
  tile.each_pixel(s, [&](long long pixel, int row, int lane) {
    const PixelBar<S> pixel_bar(s, pixel);
    behind[row][lane] = pixel_bar.carried;
    for (int k = 0; Features && k < 4; ++k) bar[k][row][lane] = pixel_bar.features[k];
  });
  Row<S> q_lane = {}, qy_lane = {}, qyy_lane = {}, features[4] = {};
  front_to_back<S>(
      s, tile, transmittance,
      [&](const Splat<S>& p, int row, Row<S> dx, Row<S> dx_part, S dy) {
        const Cover<S> cover(s, p, dx, dx_part, dy, transmittance[row]);
        const Row<S> none = S(0);
        Row<S> slope = none;
        if (Features) {
          Row<S> gain = none;
          for (int k = 0; k < 4; ++k) {
            gain += p.features[k] * bar[k][row];
            features[k] += cover.weight * bar[k][row];
          }
          behind[row] -= cover.weight * gain;
          slope = transmittance[row] * gain;
        }
        slope -= behind[row] / (S(1) - cover.alpha);
        const Row<S> q = (cover.drawn & ~cover.capped) ? cover.falloff * slope : none;
        q_lane += q, qy_lane += q * dy, qyy_lane += q * (dy * dy);
        transmittance[row] -= cover.weight;
      },
      [&](int g, Row<S> dx) {
        // q dx, q dx^2 and q dx dy need no sums of their own: dx is the same in every row.
        Row<S> all[MOMENTS] = {};
        all[Q] = q_lane, all[Q_X] = q_lane * dx, all[Q_XX] = all[Q_X] * dx;
        all[Q_Y] = qy_lane, all[Q_XY] = qy_lane * dx, all[Q_YY] = qyy_lane;
        for (int k = 0; k < 4; ++k) all[FEATURES + k] = features[k], features[k] = S(0);
        S* to = moments + (long long)g * MOMENTS;
        store<S, TILE>(to, load<S, TILE>(to) + sums(all));
        q_lane = qy_lane = qyy_lane = S(0);
      });
}

template <class S> void composite(const Scene<S>& s, int thread) {
  for (long long tile = thread; tile < s.tiles(); tile += s.threads) composite_tile(s, tile);
}

template <class S> void composite_adjoint(const Scene<S>& s, int thread) {
  S* moments = s.moments + thread * s.count * MOMENTS;
  __builtin_memset(moments, 0, s.count * MOMENTS * sizeof(S));
  for (long long tile = thread; tile < s.tiles(); tile += s.threads)
    if (s.rgb_bar || s.depth_bar)
      composite_tile_adjoint<S, true>(s, tile, moments);
    else
      composite_tile_adjoint<S, false>(s, tile, moments);
}

}  // namespace physreal

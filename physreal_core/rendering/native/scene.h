// What the phases of a rendering share, on the CPU and on CUDA: the caller's arrays, the view, and working arrays.
#pragma once

namespace physreal {

constexpr int TILE = 16;  // [px]

// A Gaussian on the image: alpha = opacity * 2^power with power = xx dx^2 + xy dx dy + yy dy^2 [1/px^2]. Where
// power < lowest alpha is under the threshold: in row dy, outside lean * dy ± sqrt(reach - narrowing * dy^2).
template <class S> struct alignas(16) Splat {
  S x, y;
  S xx, xy, yy;
  S opacity, lowest;
  S lean, reach, narrowing;
  S features[4];  // colour and depth [m]
  S unused[2];    // one cache line in single precision
};

// Sums over the pixels that a Gaussian is drawn in; q = 2^power * d loss / d alpha.
enum Moment { Q, Q_X, Q_Y, Q_XX, Q_XY, Q_YY, FEATURES, USED = FEATURES + 4, MOMENTS = 16 };

// First and last tile along x and y; first > last where nothing is drawn.
struct alignas(16) TileBox {
  int left, right, top, bottom;
};

// One view of several frames with as many Gaussians each. Those of all frames stand one after another, and so do the
// images and their tiles. Mirrored field by field in scene.py.
template <class S> struct Scene {
  long long count, frames, threads, width, height, tiles_x, tiles_y, pair_count;
  S fx, fy, cx, cy;                // [px]
  S x_low, x_high, y_low, y_high;  // x / z and y / z at which the Jacobian is taken
  S near, low_pass, alpha_min, alpha_max, transmittance_min;
  const S *means, *covariances, *opacities, *colours;  // [G, 3] m, [G, 3, 3] m^2, [G], [G, 3], in the world
  const S *pose, *background;                          // camera to world [4, 4], [3]
  Splat<S>* splats;                                    // [G]
  TileBox* boxes;                                      // [G]
  int* starts;                                         // [tiles + 1] into `lists`
  int* lists;                                          // [pairs] Gaussians of each tile, near ones first
  long long* pairs;                                    // CPU: [threads] overlaps of Gaussians and tiles
  int* cursors;                                        // CPU: [tiles]
  void *keys, *other_keys;                             // CPU: [G] depths while they are sorted
  int *order, *other_order;                            // CPU: [G]
  int *counts, *ends;                                  // CUDA: [G] tiles of each Gaussian, and their running sum
  const int* ranks;                                    // CUDA: [G] places by depth, or null: depth itself
  unsigned long long* pair_keys;                       // CUDA: [pairs] tile, then depth
  S *rgb, *depth, *alpha, *transmittance;              // [frames, H, W, 3], [frames, H, W] each
  const S *rgb_bar, *depth_bar, *alpha_bar;            // d loss / d outputs; null where none
  S* moments;                                          // [threads, G, MOMENTS]
  S *means_bar, *covariances_bar, *opacities_bar, *colours_bar;
  S* pose_bar;  // [threads, 3, 4]

  long long tiles() const { return frames * tiles_x * tiles_y; }
  // The first tile of the frame that a Gaussian belongs to.
  long long first_tile(long long g) const { return g / (count / frames) * (tiles_x * tiles_y); }
};

// Where a tile lies in its frame's image, and the number of that image's first pixel.
struct Corner {
  long long left, top, first_pixel;

  template <class S> Corner(const Scene<S>& s, long long tile)
      : left(tile % s.tiles_x * TILE),
        top(tile / s.tiles_x % s.tiles_y * TILE),
        first_pixel(tile / (s.tiles_x * s.tiles_y) * s.width * s.height) {}
};

// The loss by one pixel: by the features, divided by alpha where the output was, and what the whole ray carries.
template <class S> struct PixelBar {
  S features[4], carried;

  PixelBar(const Scene<S>& s, long long pixel) : features{}, carried(0) {
    const S T = s.transmittance[pixel], alpha = S(1) - T;
    S alpha_bar = s.alpha_bar ? s.alpha_bar[pixel] : S(0);
    if (s.rgb_bar)
      for (int k = 0; k < 3; ++k) {
        features[k] = s.rgb_bar[3 * pixel + k];
        carried += features[k] * s.rgb[3 * pixel + k];
      }
    if (s.depth_bar && alpha > S(0.5) * s.alpha_min) {
      features[3] = s.depth_bar[pixel] / alpha;
      carried += s.depth_bar[pixel] * s.depth[pixel];
      alpha_bar -= features[3] * s.depth[pixel];
    }
    carried -= T * alpha_bar;
  }
};

// RGB over the background, normalised depth and alpha of one pixel from its sums.
template <class S, class Total> inline void write_pixel(const Scene<S>& s, long long pixel, S T, Total&& total) {
  const S alpha = S(1) - T, floor = S(0.5) * s.alpha_min;
  for (int k = 0; k < 3; ++k) s.rgb[3 * pixel + k] = total(k) + T * s.background[k];
  s.depth[pixel] = total(3) / (alpha > floor ? alpha : floor);
  s.alpha[pixel] = alpha, s.transmittance[pixel] = T;
}

}  // namespace physreal

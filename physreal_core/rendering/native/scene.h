// What the phases of one rendering share: the caller's arrays, its view, and the working arrays between the phases.
#pragma once

#include "lanes.h"

namespace physreal {

constexpr int TILE = 16;  // [px] a row of a tile is one set of lanes
template <class S> using Row = Lanes<S, TILE>;
template <class S> using RowMask = Mask<S, TILE>;

// A Gaussian on the image: alpha = opacity * 2^power with power = xx dx^2 + xy dx dy + yy dy^2 [1/px^2]. Where
// power < lowest, alpha is under the threshold: in the row dy that is outside lean * dy ± sqrt(reach - narrowing * dy^2).
template <class S> struct Splat
{
    S x, y;
    S xx, xy, yy;
    S opacity, lowest;
    S lean, reach, narrowing;
    S features[4];  // colour and depth [m]
    S unused[2];    // one cache line in single precision
};

// Sums over the pixels that a Gaussian is drawn in; q = 2^power * d loss / d alpha.
enum Moment { Q, Q_X, Q_Y, Q_XX, Q_XY, Q_YY, FEATURES, MOMENTS = 16 };

// First and last tile along x and y; first > last where nothing is drawn.
struct TileBox { int left, right, top, bottom; };

// Mirrored field by field in native_backend.py.
template <class S> struct Scene
{
    using Key = typename Bits<S>::type;

    long long count, threads, width, height, tiles_x, tiles_y;
    S fx, fy, cx, cy;                                          // [px]
    S x_low, x_high, y_low, y_high;                            // x / z and y / z at which the Jacobian is taken
    S near, low_pass, alpha_min, alpha_max, transmittance_min;
    const S *means, *covariances, *opacities, *colours;        // [G, 3] m, [G, 3, 3] m^2, [G], [G, 3], in the world
    const S *pose, *background;                                // camera to world [4, 4], [3]
    Splat<S>* splats;                                          // [G]
    TileBox* boxes;                                            // [G]
    int* starts;                                               // [tiles + 1] into `lists`
    int* lists;                                                // [pairs] Gaussians of each tile, near ones first
    long long* pairs;                                          // [threads] overlaps of Gaussians and tiles
    int* cursors;                                              // [tiles]
    Key *keys, *other_keys;                                    // [G] depths while they are sorted
    int *order, *other_order;                                  // [G]
    S *rgb, *depth, *alpha, *transmittance;                    // [H, W, 3], [H, W] each
    const S *rgb_bar, *depth_bar, *alpha_bar;                  // d loss / d outputs; without rgb's and depth's: alpha alone
    S* moments;                                                // [threads, G, MOMENTS]
    S *means_bar, *covariances_bar, *opacities_bar, *colours_bar;
    S* pose_bar;                                               // [threads, 3, 4]
};

// This thread's share of `count` blocks.
struct Share
{
    long long first, end;
    Share(long long count, long long thread, long long threads)
        : first(count * thread / threads), end(count * (thread + 1) / threads)
    {
    }
};

}  // namespace physreal

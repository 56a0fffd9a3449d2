// Which Gaussians each tile shows, near ones first: one stable radix sort of the depths, then one list per tile.
#pragma once

#include "lanes.h"
#include "scene.h"

namespace physreal {

// Fills `order` with the drawn Gaussians by depth and returns their number; equal depths keep their order.
template <class S> long long sort_by_depth(const Scene<S>& s) {
  using Key = typename Number<S>::Integer;
  constexpr int DIGIT = 11, VALUES = 1 << DIGIT;
  Key *keys = static_cast<Key*>(s.keys), *to_keys = static_cast<Key*>(s.other_keys);
  int *order = s.order, *to_order = s.other_order;
  long long count = 0;
  Key low = 0, high = 0;  // bits that are 1 in all keys, and in any
  for (long long g = 0; g < s.count; ++g)
    if (s.boxes[g].left <= s.boxes[g].right) {
      const Key key = __builtin_bit_cast(Key, s.splats[g].features[3]);  // depth > 0: its bits sort as it does
      low = count ? low & key : key, high |= key;
      keys[count] = key, order[count++] = int(g);
    }
  for (int shift = 0; shift < int(8 * sizeof(Key)); shift += DIGIT) {
    if (!(((low ^ high) >> shift) & (VALUES - 1))) continue;  // all keys agree in this digit
    int places[VALUES] = {};
    for (long long i = 0; i < count; ++i) ++places[(keys[i] >> shift) & (VALUES - 1)];
    for (int i = 0, before = 0; i < VALUES; ++i) {
      const int here = places[i];
      places[i] = before, before += here;
    }
    for (long long i = 0; i < count; ++i) {
      const int place = places[(keys[i] >> shift) & (VALUES - 1)]++;
      to_keys[place] = keys[i], to_order[place] = order[i];
    }
    Key* const k = keys;
    keys = to_keys, to_keys = k;
    int* const o = order;
    order = to_order, to_order = o;
  }
  if (order != s.order) __builtin_memcpy(s.order, order, count * sizeof(int));
  return count;
}

template <class S> void list_tiles(const Scene<S>& s, int) {
  const long long count = sort_by_depth(s), tiles = s.tiles();
  for (long long t = 0; t < tiles; ++t) s.cursors[t] = 0;
  const auto each_tile = [&](long long rank, auto&& visit) {
    const TileBox& box = s.boxes[s.order[rank]];
    int* const cursors = s.cursors + s.first_tile(s.order[rank]);
    for (int y = box.top; y <= box.bottom; ++y)
      for (int x = box.left; x <= box.right; ++x) visit(cursors[y * s.tiles_x + x]);
  };
  for (long long rank = 0; rank < count; ++rank) each_tile(rank, [](int& cursor) { ++cursor; });
  int before = 0;
  for (long long t = 0; t < tiles; ++t) {
    const int here = s.cursors[t];
    s.starts[t] = s.cursors[t] = before, before += here;
  }
  s.starts[tiles] = before;
  for (long long rank = 0; rank < count; ++rank)
    each_tile(rank, [&](int& cursor) { s.lists[cursor++] = s.order[rank]; });
}

}  // namespace physreal

// A thread's range of the particles, and their rows: the structure of arrays that blocks of LANES particles are read
// from and written to, filled from and brought back to the caller's arrays, which have another order and layout.
#pragma once
#include "matrix.h"

namespace physreal {

// Part of `count` things that fall to one of `parts`: from share_of(part) to share_of(part + 1).
inline Index share_of(Index count, Index part, Index parts) { return count * part / parts; }
inline Index min_of(Index a, Index b) { return a < b ? a : b; }

template <class S>
class ParticleRows {
    using V = Lanes<S>;

public:
    ParticleRows(const Frame<S>& frame, Index thread)
        : frame_(frame),
          first_(share_of(blocks(frame), thread, frame.threads) * LANES),
          last_(min_of(share_of(blocks(frame), thread + 1, frame.threads) * LANES, frame.particles)) {}

protected:
    const Frame<S>& frame_;
    Index first_, last_;  // places; first_ is a multiple of LANES

    static Index blocks(const Frame<S>& frame) { return (frame.particles + LANES - 1) / LANES; }
    int lanes_from(Index p) const { return int(min_of(LANES, last_ - p)); }
    // End of the range with the places that fill the last block.
    Index padded_end() const { return last_ == frame_.particles ? frame_.stride : last_; }

    // Ask for `count` rows from r on of the block after the next: more rows at once than the processor follows by
    // itself.
    void fetch(const S* rows, int r, int count, Index p) const {
        const S* from = rows + r * frame_.stride + p + 2 * LANES;
        for (int i = 0; i < count; i++, from += frame_.stride) __builtin_prefetch(from);
    }

    // --- a block's values in rows r, r + 1, ...
    // ---------------------------------------------------------------------------

    V row_of(const S* rows, int r, Index p) const { return load(rows + r * frame_.stride + p); }
    void put(S* rows, int r, Index p, V value) const { store(rows + r * frame_.stride + p, value); }

    Vec3<V> vector(const S* rows, int r, Index p) const {
        return {{row_of(rows, r, p), row_of(rows, r + 1, p), row_of(rows, r + 2, p)}};
    }
    Mat3<V> matrix(const S* rows, int r, Index p) const {
        Mat3<V> M;
        for (int i = 0; i < 9; i++) M.m[i] = row_of(rows, r + i, p);
        return M;
    }
    void put(S* rows, int r, Index p, const Vec3<V>& value) const {
        for (int i = 0; i < 3; i++) put(rows, r + i, p, value.v[i]);
    }
    void put(S* rows, int r, Index p, const Mat3<V>& value) const {
        for (int i = 0; i < 9; i++) put(rows, r + i, p, value.m[i]);
    }

    // --- the caller's arrays against rows of `stride`, in the order of the cells ------------------------------------

    Index caller_of(Index p) const { return frame_.order[min_of(p, frame_.particles - 1)]; }

    // source: [N, width].
    void gather_columns(S* rows, const S* source, int width) const {
        for (Index p = first_; p < padded_end(); p++) {
            const S* from = source + width * caller_of(p);
            for (int c = 0; c < width; c++) rows[c * frame_.stride + p] = from[c];
        }
    }
    void scatter_columns(S* target, const S* rows, int width) const {
        for (Index p = first_; p < last_; p++) {
            S* to = target + width * Index(frame_.order[p]);
            for (int c = 0; c < width; c++) to[c] = rows[c * frame_.stride + p];
        }
    }
    // source: [count, N].
    void gather_rows(S* rows, const S* source, Index count) const {
        for (Index r = 0; r < count; r++)
            for (Index p = first_; p < padded_end(); p++)
                rows[r * frame_.stride + p] = source[r * frame_.particles + caller_of(p)];
    }
    void add_rows(S* target, const S* rows, Index count) const {
        for (Index r = 0; r < count; r++)
            for (Index p = first_; p < last_; p++)
                target[r * frame_.particles + frame_.order[p]] += rows[r * frame_.stride + p];
    }
    void clear(S* rows, Index count) const {
        for (Index r = 0; r < count; r++)
            for (Index p = first_; p < padded_end(); p++) rows[r * frame_.stride + p] = 0;
    }
};

}  // namespace physreal

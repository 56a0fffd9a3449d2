// The residuals' network on LANES particles at a time: two hidden layers of x / sqrt(1 + x^2), and its adjoint.
// The twin of constitutive/residual_network.py; the flat weights lie as residual_config.weight_shapes says.
#pragma once

#include "lanes.h"

namespace physreal {

constexpr int STRAIN_FEATURES = 10;
constexpr int OUTPUTS = 6;

// y[r] += sum over c of w[r ROW_STRIDE + c COLUMN_STRIDE] x[c]: weights are broadcast, TILE sums stay in registers.
template <int ROWS, int COLUMNS, int ROW_STRIDE, int COLUMN_STRIDE, class V>
inline void add_product(const Scalar<V>* w, const V* x, V* y) {
    constexpr int TILE = ROWS < 8 ? ROWS : 8;
    V sums[TILE];
    for (int r = 0; r < TILE; ++r) sums[r] = y[r];
    for (int c = 0; c < COLUMNS; ++c)
        for (int r = 0; r < TILE; ++r) sums[r] += w[r * ROW_STRIDE + c * COLUMN_STRIDE] * x[c];
    for (int r = 0; r < TILE; ++r) y[r] = sums[r];
    if constexpr (ROWS > TILE)
        add_product<ROWS - TILE, COLUMNS, ROW_STRIDE, COLUMN_STRIDE>(w + TILE * ROW_STRIDE, x, y + TILE);
}

// to[i WIDTH + j] += the sum over all particles of rows[i] columns[j]; block b's vectors lie `b * stride` further.
template <int ROWS, int COLUMNS, int WIDTH, class V>
inline void add_tile(const V* rows, const V* columns, int blocks, int stride, Scalar<V>* to) {
    V sums[ROWS][COLUMNS] = {};
    for (int b = 0; b < blocks; ++b, rows += stride, columns += stride)
        for (int i = 0; i < ROWS; ++i)
            for (int j = 0; j < COLUMNS; ++j) sums[i][j] += rows[i] * columns[j];
    for (int i = 0; i < ROWS; ++i)
        for (int j = 0; j < COLUMNS; ++j) to[i * WIDTH + j] += sum(sums[i][j]);
}

// The same for any number of rows and columns, in tiles whose sums stay in registers.
template <int ROWS, int COLUMNS, int WIDTH = COLUMNS, class V>
inline void add_outer_products(const V* rows, const V* columns, int blocks, int stride, Scalar<V>* to) {
    constexpr int TILE = 4;
    if constexpr (ROWS > TILE) {
        constexpr int LEFT = ROWS % TILE, last = ROWS - LEFT;
        for (int i = 0; i < last; i += TILE)
            add_outer_products<TILE, COLUMNS, WIDTH>(rows + i, columns, blocks, stride, to + i * WIDTH);
        if constexpr (LEFT > 0)
            add_outer_products<LEFT, COLUMNS, WIDTH>(rows + last, columns, blocks, stride, to + last * WIDTH);
    } else {
        constexpr int LEFT = COLUMNS % TILE, last = COLUMNS - LEFT;
        for (int j = 0; j < last; j += TILE) add_tile<ROWS, TILE, WIDTH>(rows, columns + j, blocks, stride, to + j);
        if constexpr (LEFT > 0) add_tile<ROWS, LEFT, WIDTH>(rows, columns + last, blocks, stride, to + last);
    }
}

// A network with LATENT numbers of a particle's own beside the strain features, and HIDDEN units in each hidden layer.
template <int LATENT_, int HIDDEN_>
struct Network {
    static constexpr bool present = true;
    static constexpr int LATENT = LATENT_, HIDDEN = HIDDEN_, INPUTS = STRAIN_FEATURES + LATENT;
    static constexpr int BIAS_1 = INPUTS * HIDDEN, WEIGHT_2 = BIAS_1 + HIDDEN, BIAS_2 = WEIGHT_2 + HIDDEN * HIDDEN;
    static constexpr int WEIGHT_3 = BIAS_2 + HIDDEN, BIAS_3 = WEIGHT_3 + OUTPUTS * HIDDEN;

    template <class V>
    struct Activations {
        V inputs[INPUTS], one, first[HIDDEN], one_again, second[HIDDEN];  // the ones stand for the biases' inputs
    };

    // Of the hidden layers, at the present activations.
    template <class V>
    struct Slopes {
        V first[HIDDEN], second[HIDDEN];
    };

    // From `inputs` to the rest, and to the outputs.
    template <class V>
    static void forward(const Scalar<V>* weights, Activations<V>& h, Slopes<V>& slopes, V (&outputs)[OUTPUTS]) {
        h.one = h.one_again = splat<V>(1);
        for (int i = 0; i < HIDDEN; ++i) h.first[i] = splat<V>(weights[BIAS_1 + i]);
        add_product<HIDDEN, INPUTS, 1, HIDDEN>(weights, h.inputs, h.first);
        activate(h.first, slopes.first);
        for (int i = 0; i < HIDDEN; ++i) h.second[i] = splat<V>(weights[BIAS_2 + i]);
        add_product<HIDDEN, HIDDEN, 1, HIDDEN>(weights + WEIGHT_2, h.first, h.second);
        activate(h.second, slopes.second);
        for (int o = 0; o < OUTPUTS; ++o) outputs[o] = splat<V>(weights[BIAS_3 + o]);
        add_product<OUTPUTS, HIDDEN, HIDDEN, 1>(weights + WEIGHT_3, h.second, outputs);
    }

    // The adjoint, over many blocks: the weights' is a matrix product over all particles, made of a batch at a time.
    template <class S>
    class Adjoint {
        using V = Lanes<S>;
        struct Block {
            Activations<V> h;
            V outputs_bar[OUTPUTS], second_bar[HIDDEN], first_bar[HIDDEN];  // of the sums that go into the activations
        };
        static constexpr int BATCH = 16, STRIDE = sizeof(Block) / sizeof(V);

        Block* batch_;
        S* weights_bar_;
        int count_ = 0;

    public:
        static constexpr int workspace_size = BATCH * sizeof(Block) / sizeof(S) + LANES;  // scalars; room to align

        Adjoint(S* workspace, S* weights_bar)
            : batch_(reinterpret_cast<Block*>(__builtin_align_up(workspace, alignof(V)))), weights_bar_(weights_bar) {}

        // Inputs' adjoint of one block; the weights' is added when the batch is full or finished.
        void operator()(const S* weights, const Activations<V>& h, const Slopes<V>& slopes,
                        const V (&outputs_bar)[OUTPUTS], V (&inputs_bar)[INPUTS]) {
            Block& block = batch_[count_];
            block.h = h;
            for (int o = 0; o < OUTPUTS; ++o) block.outputs_bar[o] = outputs_bar[o];
            for (int i = 0; i < HIDDEN; ++i) block.second_bar[i] = block.first_bar[i] = V{};
            add_product<HIDDEN, OUTPUTS, 1, HIDDEN>(weights + WEIGHT_3, outputs_bar, block.second_bar);
            for (int i = 0; i < HIDDEN; ++i) block.second_bar[i] *= slopes.second[i];
            add_product<HIDDEN, HIDDEN, HIDDEN, 1>(weights + WEIGHT_2, block.second_bar, block.first_bar);
            for (int i = 0; i < HIDDEN; ++i) block.first_bar[i] *= slopes.first[i];
            for (int i = 0; i < INPUTS; ++i) inputs_bar[i] = V{};
            add_product<INPUTS, HIDDEN, HIDDEN, 1>(weights, block.first_bar, inputs_bar);
            if (++count_ == BATCH) finish();
        }

        void finish() {
            const Block& b = batch_[0];
            add_outer_products<INPUTS + 1, HIDDEN>(b.h.inputs, b.first_bar, count_, STRIDE, weights_bar_);
            add_outer_products<HIDDEN + 1, HIDDEN>(b.h.first, b.second_bar, count_, STRIDE, weights_bar_ + WEIGHT_2);
            add_outer_products<OUTPUTS, HIDDEN>(b.outputs_bar, b.h.second, count_, STRIDE, weights_bar_ + WEIGHT_3);
            add_outer_products<OUTPUTS, 1>(b.outputs_bar, &b.h.one, count_, STRIDE, weights_bar_ + BIAS_3);
            count_ = 0;
        }
    };

private:
    template <class V>
    static void activate(V (&x)[HIDDEN], V (&slope)[HIDDEN]) {
        for (int i = 0; i < HIDDEN; ++i) {
            const V r = inverse_sqrt(Scalar<V>(1) + x[i] * x[i]);
            slope[i] = r * r * r;
            x[i] *= r;
        }
    }
};

// In place of a network where there is none.
struct NoNetwork {
    static constexpr bool present = false;
    static constexpr int LATENT = 0;

    template <class S>
    struct Adjoint {
        static constexpr int workspace_size = 0;
        Adjoint(S*, S*) {}
        void finish() {}
    };
};

}  // namespace physreal

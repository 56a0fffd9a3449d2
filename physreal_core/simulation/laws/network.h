// The residuals' network: two hidden layers of x / sqrt(1 + x^2), and its adjoint. That activation (the inverse square
// root unit of Carlile et al. 2017) is smooth and bounded like tanh, and vectorises. The flat weights lie as
// residual_config.weight_shapes says.
#pragma once

#include "number.h"
#include "shared_sum.h"

namespace physreal {

constexpr int STRAIN_FEATURES = 10;
constexpr int OUTPUTS = 6;

// y[r] += sum over c of w[r ROW_STRIDE + c COLUMN_STRIDE] x[c]: weights are broadcast, TILE sums stay in registers.
template <int ROWS, int COLUMNS, int ROW_STRIDE, int COLUMN_STRIDE, class V>
inline void add_product(const Scalar<V>* w, const V* x, V* y) {
    constexpr int TILE = ROWS < 8 ? ROWS : 8;
    V sums[TILE];
    for (int r = 0; r < TILE; ++r) sums[r] = y[r];
    ONE_AT_A_TIME for (int c = 0; c < COLUMNS; ++c) for (int r = 0; r < TILE; ++r) sums[r] +=
        w[r * ROW_STRIDE + c * COLUMN_STRIDE] * x[c];
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

// The weights' adjoint is a matrix product over all particles, made of a batch of blocks at a time.
template <class Net, class V>
class BatchedAdjoint {
    using S = Scalar<V>;
    static constexpr int HIDDEN = Net::HIDDEN, INPUTS = Net::INPUTS;
    struct Block {
        typename Net::template Activations<V> h;
        V outputs_bar[OUTPUTS], second_bar[HIDDEN], first_bar[HIDDEN];  // of the sums that go into the activations
    };
    static constexpr int BATCH = 16, STRIDE = sizeof(Block) / sizeof(V);

    Block* batch_;
    S* weights_bar_;
    int count_ = 0;

public:
    static constexpr int workspace_size =
        BATCH * sizeof(Block) / sizeof(S) + LaneTraits<V>::COUNT;  // scalars; room to align

    BatchedAdjoint(S* workspace, S* weights_bar)
        : batch_(reinterpret_cast<Block*>((reinterpret_cast<unsigned long long>(workspace) + alignof(V) - 1) /
                                          alignof(V) * alignof(V))),
          weights_bar_(weights_bar) {}

    // Inputs' adjoint of one block; the weights' is added when the batch is full or finished.
    void operator()(const S* weights, const typename Net::template Activations<V>& h,
                    const typename Net::template Slopes<V>& slopes, const V (&outputs_bar)[OUTPUTS],
                    V (&inputs_bar)[INPUTS]) {
        Block& block = batch_[count_];
        block.h = h;
        for (int o = 0; o < OUTPUTS; ++o) block.outputs_bar[o] = outputs_bar[o];
        Net::sums_adjoint(weights, slopes, outputs_bar, block.second_bar, block.first_bar, inputs_bar);
        if (++count_ == BATCH) finish();
    }

    void finish() {
        const Block& b = batch_[0];
        add_outer_products<INPUTS + 1, HIDDEN>(b.h.inputs, b.first_bar, count_, STRIDE, weights_bar_);
        add_outer_products<HIDDEN + 1, HIDDEN>(b.h.first, b.second_bar, count_, STRIDE, weights_bar_ + Net::WEIGHT_2);
        add_outer_products<OUTPUTS, HIDDEN>(b.outputs_bar, b.h.second, count_, STRIDE, weights_bar_ + Net::WEIGHT_3);
        add_outer_products<OUTPUTS, 1>(b.outputs_bar, &b.h.one, count_, STRIDE, weights_bar_ + Net::BIAS_3);
        count_ = 0;
    }
};

// One particle adds its share of the weights' adjoint at once, together with its neighbours on a GPU.
template <class Net, class S>
class SharedAdjoint {
    static constexpr int HIDDEN = Net::HIDDEN, INPUTS = Net::INPUTS;
    S* weights_bar_;

    static void add_row(S* to, S factor, const S* columns) {
        S row[HIDDEN];
        for (int j = 0; j < HIDDEN; ++j) row[j] = factor * columns[j];
        add_shared<HIDDEN>(to, row);
    }

public:
    static constexpr int workspace_size = 0;

    SharedAdjoint(S*, S* weights_bar) : weights_bar_(weights_bar) {}

    void operator()(const S* weights, const typename Net::template Activations<S>& h,
                    const typename Net::template Slopes<S>& slopes, const S (&outputs_bar)[OUTPUTS],
                    S (&inputs_bar)[INPUTS]) {
        S second_bar[HIDDEN], first_bar[HIDDEN];
        Net::sums_adjoint(weights, slopes, outputs_bar, second_bar, first_bar, inputs_bar);
        const S* inputs = h.inputs;  // a one for the bias follows, as after `first`
        ONE_AT_A_TIME for (int i = 0; i <= INPUTS; ++i) add_row(weights_bar_ + i * HIDDEN, inputs[i], first_bar);
        ONE_AT_A_TIME for (int i = 0; i <= HIDDEN; ++i)
            add_row(weights_bar_ + Net::WEIGHT_2 + i * HIDDEN, h.first[i], second_bar);
        ONE_AT_A_TIME for (int o = 0; o < OUTPUTS; ++o)
            add_row(weights_bar_ + Net::WEIGHT_3 + o * HIDDEN, outputs_bar[o], h.second);
        S bias[OUTPUTS];
        for (int o = 0; o < OUTPUTS; ++o) bias[o] = outputs_bar[o];
        add_shared<OUTPUTS>(weights_bar_ + Net::BIAS_3, bias);
    }

    void finish() {}
};

template <bool FIRST, class A, class B>
struct Chosen {
    using type = A;
};
template <class A, class B>
struct Chosen<false, A, B> {
    using type = B;
};
template <bool FIRST, class A, class B>
using Choose = typename Chosen<FIRST, A, B>::type;

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

    // The adjoint of a block of lanes or of one particle.
    template <class V>
    using Adjoint = Choose<(LaneTraits<V>::COUNT > 1), BatchedAdjoint<Network, V>, SharedAdjoint<Network, V>>;

    // Adjoints of the inputs, and of the sums that go into the activations.
    template <class V>
    static void sums_adjoint(const Scalar<V>* weights, const Slopes<V>& slopes, const V (&outputs_bar)[OUTPUTS],
                             V (&second_bar)[HIDDEN], V (&first_bar)[HIDDEN], V (&inputs_bar)[INPUTS]) {
        for (int i = 0; i < HIDDEN; ++i) second_bar[i] = first_bar[i] = V{};
        add_product<HIDDEN, OUTPUTS, 1, HIDDEN>(weights + WEIGHT_3, outputs_bar, second_bar);
        for (int i = 0; i < HIDDEN; ++i) second_bar[i] *= slopes.second[i];
        add_product<HIDDEN, HIDDEN, HIDDEN, 1>(weights + WEIGHT_2, second_bar, first_bar);
        for (int i = 0; i < HIDDEN; ++i) first_bar[i] *= slopes.first[i];
        for (int i = 0; i < INPUTS; ++i) inputs_bar[i] = V{};
        add_product<INPUTS, HIDDEN, HIDDEN, 1>(weights, first_bar, inputs_bar);
    }

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

    template <class V>
    struct Adjoint {
        static constexpr int workspace_size = 0;
        Adjoint(Scalar<V>*, Scalar<V>*) {}
        void finish() {}
    };
};

}  // namespace physreal

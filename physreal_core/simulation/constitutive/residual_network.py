"""The residuals' network on one particle as a Warp function, with its adjoint: two hidden layers of x / sqrt(1 + x^2).

That activation (the inverse square root unit of Carlile et al. 2017) is smooth and bounded like tanh, and vectorises.
"""

from dataclasses import dataclass
from functools import cache

import warp as wp

from physreal_core.simulation.constitutive.residual_config import OUTPUTS, STRAIN_FEATURES, ResidualConfig
from physreal_core.simulation.constitutive.shared_sum import shared_adder


@dataclass(frozen=True)
class Network:
    """Warp functions of one network over one scalar type, with the vector types of its strain features and outputs.

    Attributes:
        Strains, Outputs: vectors of length 10 and 6.
        forward: `(strains, particle, latent [N, L], weights [W]) -> Outputs`.
        adjoint: `(strains, particle, latent, weights, outputs_bar, latent_bar [N, L], weights_bar [rows, W], row)
            -> strains_bar`; adds to `latent_bar[particle]` and, many particles at once, to `weights_bar[row]`.
    """

    Strains: type
    Outputs: type
    forward: wp.Function
    adjoint: wp.Function


@cache
def network_functions(config: ResidualConfig, scalar: type) -> Network:
    """The network of `config` over `scalar`."""
    one = scalar(1.0)
    inverse_scale = scalar(1.0 / config.strain_scale)
    input_count, hidden_count = config.input_size, config.hidden
    Strains = wp.types.vector(STRAIN_FEATURES, scalar)
    Outputs = wp.types.vector(OUTPUTS, scalar)
    Inputs = wp.types.vector(input_count, scalar)
    Hidden = wp.types.vector(hidden_count, scalar)
    # The flat weights as rows of the hidden layers' width: weight_1, bias_1, weight_2, bias_2, weight_3; then bias_3.
    # Whole rows at a time vectorise, single entries do not.
    row_bias_1 = input_count
    row_weight_2 = row_bias_1 + 1
    row_bias_2 = row_weight_2 + hidden_count
    row_weight_3 = row_bias_2 + 1
    row_count = row_weight_3 + OUTPUTS
    bias_3 = row_count * hidden_count
    add_hidden, add_outputs = shared_adder(Hidden, scalar), shared_adder(Outputs, scalar)

    @wp.struct
    class Activations:
        inputs: Inputs
        first: Hidden
        second: Hidden

    @wp.func
    def rows_of(flat: wp.array(dtype=scalar)):
        return wp.array(ptr=flat.ptr, shape=(row_count,), dtype=Hidden)

    @wp.func
    def activate(x: Hidden):
        y = Hidden()
        for i in range(hidden_count):
            y[i] = x[i] / wp.sqrt(one + x[i] * x[i])
        return y

    @wp.func
    def activate_adjoint(y: Hidden, y_bar: Hidden):
        x_bar = Hidden()
        for i in range(hidden_count):
            s = one - y[i] * y[i]  # 1 / (1 + x^2)
            x_bar[i] = y_bar[i] * s * wp.sqrt(s)
        return x_bar

    @wp.func
    def activations(strains: Strains, particle: int, latent: wp.array2d(dtype=scalar), weights: wp.array(dtype=scalar)):
        # int(): a bound that Warp knows while compiling would be unrolled into thousands of lines
        inputs, hidden, strain_features = int(input_count), int(hidden_count), int(STRAIN_FEATURES)
        rows = rows_of(weights)
        out = Activations()
        x = Inputs()
        for j in range(STRAIN_FEATURES):
            x[j] = inverse_scale * strains[j]
        for j in range(strain_features, inputs):
            x[j] = latent[particle, j - strain_features]
        a = rows[row_bias_1]
        for j in range(inputs):
            a += x[j] * rows[j]
        out.inputs = x
        out.first = activate(a)
        a = rows[row_bias_2]
        for j in range(hidden):
            a += out.first[j] * rows[row_weight_2 + j]
        out.second = activate(a)
        return out

    @wp.func
    def forward(strains: Strains, particle: int, latent: wp.array2d(dtype=scalar), weights: wp.array(dtype=scalar)):
        rows = rows_of(weights)
        second = activations(strains, particle, latent, weights).second
        out = Outputs()
        for o in range(OUTPUTS):
            out[o] = weights[bias_3 + o] + wp.dot(rows[row_weight_3 + o], second)
        return out

    @wp.func
    def adjoint(
        strains: Strains,
        particle: int,
        latent: wp.array2d(dtype=scalar),
        weights: wp.array(dtype=scalar),
        out_bar: Outputs,
        latent_bar: wp.array2d(dtype=scalar),
        weights_bar: wp.array2d(dtype=scalar),
        row: int,
    ):
        inputs, hidden, strain_features = int(input_count), int(hidden_count), int(STRAIN_FEATURES)
        rows = rows_of(weights)
        h = activations(strains, particle, latent, weights)
        a_bar = Hidden()
        for o in range(OUTPUTS):
            a_bar += out_bar[o] * rows[row_weight_3 + o]
            add_hidden(weights_bar, row, (row_weight_3 + o) * hidden_count, out_bar[o] * h.second)
        add_outputs(weights_bar, row, bias_3, out_bar)
        a_bar = activate_adjoint(h.second, a_bar)
        first_bar = Hidden()
        add_hidden(weights_bar, row, row_bias_2 * hidden_count, a_bar)
        for j in range(hidden):
            first_bar[j] = wp.dot(rows[row_weight_2 + j], a_bar)
            add_hidden(weights_bar, row, (row_weight_2 + j) * hidden_count, h.first[j] * a_bar)
        a_bar = activate_adjoint(h.first, first_bar)
        inputs_bar = Inputs()
        add_hidden(weights_bar, row, row_bias_1 * hidden_count, a_bar)
        for j in range(inputs):
            inputs_bar[j] = wp.dot(rows[j], a_bar)
            add_hidden(weights_bar, row, j * hidden_count, h.inputs[j] * a_bar)
        strains_bar = Strains()
        for j in range(STRAIN_FEATURES):
            strains_bar[j] = inverse_scale * inputs_bar[j]
        for j in range(strain_features, inputs):
            q = j - strain_features
            latent_bar[particle, q] = latent_bar[particle, q] + inputs_bar[j]
        return strains_bar

    return Network(Strains, Outputs, forward, adjoint)

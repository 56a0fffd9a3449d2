"""The residuals' network on one particle as a Warp function, with its adjoint: two hidden layers of x / sqrt(1 + x^2).

That activation (the inverse square root unit of Carlile et al. 2017) is smooth and bounded like tanh, and vectorises.
"""

from dataclasses import dataclass
from functools import cache

import warp as wp

from physreal_core.simulation.constitutive.residual_config import OUTPUTS, STRAIN_FEATURES, ResidualConfig


@dataclass(frozen=True)
class Network:
    """Warp functions of one network over one scalar type, with the vector types of its strain features and outputs.

    Attributes:
        Strains, Outputs: vectors of length 10 and 6.
        forward: `(strains, particle, latent [N, L], weights [W]) -> Outputs`.
        adjoint: `(strains, particle, latent, weights, outputs_bar, latent_bar [N, L], weights_bar [rows, W], row)
            -> strains_bar`; adds to `latent_bar[particle]` and, atomically, to `weights_bar[row]`.
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
    bias_1 = input_count * hidden_count
    weight_2 = bias_1 + hidden_count
    bias_2 = weight_2 + hidden_count * hidden_count
    weight_3 = bias_2 + hidden_count
    bias_3 = weight_3 + hidden_count * OUTPUTS

    @wp.struct
    class Activations:
        inputs: Inputs
        first: Hidden
        second: Hidden

    # Loop bounds pass through int(): a bound that Warp knows while compiling would be unrolled into thousands of lines.

    @wp.func
    def activate(x: Hidden):
        n = int(hidden_count)
        y = Hidden()
        for i in range(n):
            y[i] = x[i] / wp.sqrt(one + x[i] * x[i])
        return y

    @wp.func
    def activate_adjoint(y: Hidden, y_bar: Hidden):
        n = int(hidden_count)
        x_bar = Hidden()
        for i in range(n):
            s = one - y[i] * y[i]  # 1 / (1 + x^2)
            x_bar[i] = y_bar[i] * s * wp.sqrt(s)
        return x_bar

    @wp.func
    def activations(
        strains: Strains, particle: int, latent: wp.array2d(dtype=scalar), weights: wp.array(dtype=scalar)
    ):
        inputs, hidden, strain_features = int(input_count), int(hidden_count), int(STRAIN_FEATURES)
        out = Activations()
        x = Inputs()
        for j in range(strain_features):
            x[j] = inverse_scale * strains[j]
        for j in range(strain_features, inputs):
            x[j] = latent[particle, j - strain_features]
        a = Hidden()
        for i in range(hidden):
            a[i] = weights[bias_1 + i]
        for j in range(inputs):
            for i in range(hidden):
                a[i] += x[j] * weights[j * hidden + i]
        first = activate(a)
        for i in range(hidden):
            a[i] = weights[bias_2 + i]
        for j in range(hidden):
            for i in range(hidden):
                a[i] += first[j] * weights[weight_2 + j * hidden + i]
        out.inputs = x
        out.first = first
        out.second = activate(a)
        return out

    @wp.func
    def forward(strains: Strains, particle: int, latent: wp.array2d(dtype=scalar), weights: wp.array(dtype=scalar)):
        hidden = int(hidden_count)
        h = activations(strains, particle, latent, weights)
        out = Outputs()
        for o in range(OUTPUTS):
            out[o] = weights[bias_3 + o]
        for j in range(hidden):
            for o in range(OUTPUTS):
                out[o] += h.second[j] * weights[weight_3 + j * OUTPUTS + o]
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
        h = activations(strains, particle, latent, weights)
        second_bar = Hidden()
        for o in range(OUTPUTS):
            wp.atomic_add(weights_bar, row, bias_3 + o, out_bar[o])
        for j in range(hidden):
            for o in range(OUTPUTS):
                k = weight_3 + j * OUTPUTS + o
                second_bar[j] += weights[k] * out_bar[o]
                wp.atomic_add(weights_bar, row, k, h.second[j] * out_bar[o])
        a_bar = activate_adjoint(h.second, second_bar)
        first_bar = Hidden()
        for i in range(hidden):
            wp.atomic_add(weights_bar, row, bias_2 + i, a_bar[i])
        for j in range(hidden):
            for i in range(hidden):
                k = weight_2 + j * hidden + i
                first_bar[j] += weights[k] * a_bar[i]
                wp.atomic_add(weights_bar, row, k, h.first[j] * a_bar[i])
        a_bar = activate_adjoint(h.first, first_bar)
        inputs_bar = Inputs()
        for i in range(hidden):
            wp.atomic_add(weights_bar, row, bias_1 + i, a_bar[i])
        for j in range(inputs):
            for i in range(hidden):
                k = j * hidden + i
                inputs_bar[j] += weights[k] * a_bar[i]
                wp.atomic_add(weights_bar, row, k, h.inputs[j] * a_bar[i])
        strains_bar = Strains()
        for j in range(strain_features):
            strains_bar[j] = inverse_scale * inputs_bar[j]
        for j in range(strain_features, inputs):
            q = j - strain_features
            latent_bar[particle, q] = latent_bar[particle, q] + inputs_bar[j]
        return strains_bar

    return Network(Strains, Outputs, forward, adjoint)

// Drucker-Prager plasticity with cohesion: |dev tau| + alpha tr(tau) <= k in the Hencky stress, flow without dilatancy.
//
// y = (friction angle phi [rad], cohesion c [Pa]), alpha = sqrt(2/3) 2 sin phi / (3 - sin phi) and k = sqrt(2/3) 6 c
// cos phi / (3 - sin phi): the cone through the outer (triaxial compression) edges of Mohr-Coulomb's. Beyond the tip
// tr(tau) = k / alpha = 3 c cot phi the strain goes to the tip: the material opens without resistance. Source: Klar et
// al., "Drucker-Prager elastoplasticity for sand animation", SIGGRAPH 2016 (their case c = 0; cohesion shifts the cone
// along the hydrostatic axis). Their volume correction is left out, since it needs a state variable.
#pragma once

#include "lame.h"
#include "return_map.h"

namespace physreal {

struct DruckerPrager : ReturnMap<DruckerPrager> {
    static constexpr double ROOT = 0.81649658092772603273;  // sqrt(2/3)

    // alpha and k of the cone, and how they change with y.
    template <class V>
    struct Cone {
        using S = Scalar<V>;
        V sine, cosine, inverse, cohesion, alpha, k;

        Cone(V angle, V cohesion) : cohesion(cohesion) {
            sin_cos(angle, sine, cosine);
            inverse = S(ROOT) / (S(3) - sine);
            alpha = S(2) * inverse * sine;
            k = S(6) * inverse * cohesion * cosine;
        }

        V angle_bar(V alpha_bar, V k_bar) const {
            return S(6.0 / ROOT) * (inverse * inverse) * (alpha_bar * cosine + k_bar * cohesion * (S(1) - S(3) * sine));
        }
        V cohesion_bar(V k_bar) const { return S(6) * inverse * k_bar * cosine; }
    };

    template <class V>
    static Radial<V> radial(V q, V t, V E, V nu, V y0, V y1, Scalar<V>) {
        using S = Scalar<V>;
        const Lame<V> lame(E, nu);
        const Cone<V> cone(y0, y1);
        const V two_mu = S(2) * lame.mu, slope = cone.alpha * lame.three_bulk();
        const V strength = cone.k - slope * t;  // what |dev tau| may reach at this trace
        const Mask<V> opens = strength < S(0);
        return {two_mu * q > strength, select(opens, V{}, strength / two_mu), select(opens, cone.k / slope, t)};
    }

    template <class V>
    static RadialAdjoint<V> radial_adjoint(V, V t, V E, V nu, V y0, V y1, Scalar<V>, V q_new_bar, V t_new_bar) {
        using S = Scalar<V>;
        const Lame<V> lame(E, nu);
        const Cone<V> cone(y0, y1);
        const V two_mu = S(2) * lame.mu, slope = cone.alpha * lame.three_bulk();
        const V strength = cone.k - slope * t;
        const Mask<V> opens = strength < S(0);
        const V k_bar = select(opens, t_new_bar / slope, q_new_bar / two_mu);
        const V slope_bar = select(opens, -k_bar * cone.k / slope, -k_bar * t);
        const V two_mu_bar = select(opens, V{}, -k_bar * strength / two_mu);
        const V t_bar = select(opens, V{}, t_new_bar - k_bar * slope);
        const V bulk_bar = slope_bar * cone.alpha;
        const LameAdjoint<V> material = lame.adjoint(S(2) * (two_mu_bar + bulk_bar), S(3) * bulk_bar);
        const V angle_bar = cone.angle_bar(slope_bar * lame.three_bulk(), k_bar);
        return {V{}, t_bar, material.E, material.nu, angle_bar, cone.cohesion_bar(k_bar)};
    }
};

}  // namespace physreal

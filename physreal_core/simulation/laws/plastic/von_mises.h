// Von Mises plasticity with Perzyna viscosity: |dev tau| <= sqrt(2/3) sigma_y, with dev tau = 2 mu dev eps (Hencky).
//
// y = (yield stress sigma_y in uniaxial tension [Pa], viscosity eta [Pa s]). Above the surface the deviatoric log
// strain flows at (|dev tau| - sqrt(2/3) sigma_y) / eta, integrated implicitly: a step keeps (eta/dt) / (2 mu + eta/dt)
// of the excess over the surface, so that the material does not depend on dt. eta = 0 is perfect plasticity, the radial
// return. Sources: Simo and Hughes, "Computational Inelasticity", 1998 (radial return; Perzyna); in log strain: Simo,
// CMAME 99 (1992). There is no hardening: it would need the accumulated plastic strain as a state variable that the
// particles do not carry.
#pragma once

#include "lame.h"
#include "return_map.h"

namespace physreal {

struct VonMises : ReturnMap<VonMises> {
    static constexpr double ROOT = 0.81649658092772603273;  // sqrt(2/3)

    template <class V>
    static Radial<V> radial(V q, V t, V E, V nu, V y0, V y1, Scalar<V> dt) {
        using S = Scalar<V>;
        const V two_mu = S(2) * Lame<V>(E, nu).mu;
        const V radius = S(ROOT) * y0 / two_mu;
        return {q > radius, q - (q - radius) * two_mu / (two_mu + y1 / dt), t};
    }

    template <class V>
    static RadialAdjoint<V> radial_adjoint(V q, V, V E, V nu, V y0, V y1, Scalar<V> dt, V q_new_bar, V t_new_bar) {
        using S = Scalar<V>;
        const Lame<V> lame(E, nu);
        const V two_mu = S(2) * lame.mu, stiffness = two_mu + y1 / dt;
        const V fraction = two_mu / stiffness, radius = S(ROOT) * y0 / two_mu, excess = q - radius;
        const V radius_bar = q_new_bar * fraction;
        const V two_mu_bar = -radius_bar * radius / two_mu - q_new_bar * excess * (S(1) - fraction) / stiffness;
        const LameAdjoint<V> material = lame.adjoint(S(2) * two_mu_bar, V{});
        return {q_new_bar * (S(1) - fraction),
                t_new_bar,
                material.E,
                material.nu,
                radius_bar * S(ROOT) / two_mu,
                q_new_bar * excess * fraction / (stiffness * dt)};
    }
};

}  // namespace physreal

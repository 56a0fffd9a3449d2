// Friction of a node that slides: mu(s) = max(0, mu_f + excess exp(-s / static speed) + rate s), Coulomb's where there
// is no law. The twin stands in terms_reference.py, with its source.
#pragma once
#include "number.h"

namespace physreal {

// mu(s), and its derivatives by s, by mu_f and by the law's three numbers; all zero where it would be negative.
template <class S>
struct Friction {
    S value, by_speed, by_dynamic, by_law[3];

    // Coulomb's.
    explicit Friction(S dynamic) : value(dynamic), by_speed(0), by_dynamic(1), by_law{} {}

    // law: static excess, static speed [m/s], rate [s/m].
    Friction(S dynamic, const S* law, S speed) : value(0), by_speed(0), by_dynamic(0), by_law{} {
        const S fade = exp(-speed / law[1]);
        const S mu = dynamic + law[0] * fade + law[2] * speed;
        if (!(mu > 0)) return;
        value = mu;
        by_speed = law[2] - law[0] * fade / law[1];
        by_dynamic = 1;
        by_law[0] = fade;
        by_law[1] = law[0] * fade * speed / (law[1] * law[1]);
        by_law[2] = speed;
    }
};

// What grows with every node that slides.
template <class S>
struct FrictionBar {
    S dynamic, law[3];

    void add(const Friction<S>& friction, S bar) {
        dynamic += bar * friction.by_dynamic;
        for (int i = 0; i < 3; i++) law[i] += bar * friction.by_law[i];
    }
};

}  // namespace physreal

// What one frame is given and what it leaves: plain data that stepper.py fills (same order and types there).
#pragma once
#include "lanes.h"
#include "terms.h"

namespace physreal {

// Particle arrays come in the caller's order and layout; the frame works on copies of them in the order of the cells,
// as rows of `stride` numbers (structure of arrays). S is float or double.
template <class S>
struct Frame {
    // Sizes:
    Index particles, stride, threads, substeps;
    Index keep_states, keep_grids;  // whether those of all substeps stay
    Index replay;                   // whether the grids are there already
    Index origin[3], count[3];      // the box of nodes
    Index gripped, clamps, has_ground;
    Index latent_elastic_size, latent_plastic_size, weights_elastic, weights_plastic;
    Index workspace_size;  // numbers of workspace per thread
    Index yield_;          // address of a function that gives the core to another thread, or 0
    Index terms;           // bits of the optional laws in use, see terms.h

    // Model:
    S offset[3], cell, dt, share, frame_rate, gravity[3], mass_floor, touching;
    S friction, grip_stiffness, grip_damping, grip_softening;
    S beta_elastic, beta_plastic, strain_scale;
    S term_numbers[TERM_NUMBERS], remembered;  // share of the mean rate of deformation that a substep keeps

    // Particles in the caller's order:
    const int* order;                                             // [N] the caller's particle at each place
    S *x, *v, *F, *C;                                             // [N, 3], [N, 3], [N, 3, 3], [N, 3, 3]; in and out
    const S *mass, *volume, *load;                                // [N], [N], [N, 3]
    const S *E, *nu, *plastic, *latent_elastic, *latent_plastic;  // [N], [N], [N, 2], [N, L], [N, L]
    const S *network_elastic, *network_plastic;
    S *x_bar, *v_bar, *F_bar, *C_bar;                                           // in and out
    S *E_bar, *nu_bar, *plastic_bar, *latent_elastic_bar, *latent_plastic_bar;  // grow
    S *network_elastic_bar, *network_plastic_bar;                               // [threads, weights]; grow
    S* sums;                            // [threads, SUMS] adjoints of what all particles share; grow
    const S* term_values;               // [N, TERM_ROWS]
    S *rate, *rate_bar;                 // [N, 3, 3] mean rate of deformation, with viscosity; in and out
    S *mass_bar, *load_bar, *term_bar;  // [N], [N, 3], [N, TERM_ROWS]; grow

    // Grip bonds by particle, and what is held:
    const int *grip_particle, *grip_first, *grip_controller;  // [Q], [Q + 1], [B]
    const S *grip_weight, *grip_rest_length, *controllers;    // [B], [B], [2, points, 3] at both ends of the frame
    Index controller_points;
    S* controllers_bar;                  // [threads, 2, points, 3]; grow
    const S *clamp_lower, *clamp_upper;  // [clamps, 3]

    // Workspace:
    int* place;              // [N] place of the caller's particle
    S* state;                // [slots, rows, stride] x, v, F, C and, with viscosity, the mean rate of deformation
    S *constants, *bars;     // rows of `stride`: see Worker
    S* force;                // [3, stride]
    S* force_bar;            // [3, stride], with optional terms
    S* adjoint;              // [rows, stride] of the state
    S* scratch;              // [threads, nodes + 4, 4] a grid to scatter to for every thread
    S *velocity, *node_bar;  // [nodes + 4, 4]
    S* momentum;             // [substeps, nodes, 4] if kept
    unsigned char* kind;     // [nodes]
    S* workspace;            // [threads, workspace_size]
    int* shared;             // [64] barrier and stop
    Index* status;  // [threads, 2] first failure as substep * particles + particle: outside the grid, not finite
};

}  // namespace physreal

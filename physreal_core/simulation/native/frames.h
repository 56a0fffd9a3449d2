// Which thread runs which frames, of whatever kind.
#pragma once
#include "number.h"

namespace physreal {

// Calls run(frame, thread within it) for the frames: one is shared by all threads, of many each thread takes one after
// the other.
template <class S, template <class> class FrameOf, class Run>
inline void for_frames(unsigned long long frames, unsigned long long workspaces, int count, unsigned long long next,
                       int thread, Run run) {
    const auto all = reinterpret_cast<const FrameOf<S>*>(frames);
    const auto work = reinterpret_cast<const Workspace<S>*>(workspaces);
    const auto frame_on = [&](int i, int workspace) {
        FrameOf<S> frame = all[i];
        static_cast<Workspace<S>&>(frame) = work[workspace];
        if (frame.kept_grids) frame.free = frame.kept_grids;
        return frame;
    };
    if (count == 1) return run(frame_on(0, 0), thread);
    for (;;) {
        const int i = __atomic_fetch_add(reinterpret_cast<int*>(next), 1, __ATOMIC_RELAXED);
        if (i >= count) return;
        const FrameOf<S> frame = frame_on(i, thread);
        __builtin_memset(frame.shared, 0, 128 * sizeof(int));
        run(frame, 0);
    }
}

}  // namespace physreal

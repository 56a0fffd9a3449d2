// Meeting point of the threads of one frame, all of which run; spins, and gives the core away where it takes long.
#pragma once

namespace physreal {

class Barrier {
public:
    // shared: 32 integers that are zero when the first thread starts.
    Barrier(int* shared, Index threads, Index yield) : shared_(shared), threads_(int(threads)), yield_(yield) {}

    void wait() {
        phase_++;
        if (threads_ == 1) return;
        int *arrived = shared_, *done = shared_ + 16;  // a cache line each
        if (__atomic_add_fetch(arrived, 1, __ATOMIC_ACQ_REL) == threads_ * phase_) {
            __atomic_store_n(done, phase_, __ATOMIC_RELEASE);
            return;
        }
        for (int spins = 1; __atomic_load_n(done, __ATOMIC_ACQUIRE) < phase_; spins++)
            if (spins % 2000 == 0 && yield_) reinterpret_cast<int (*)()>(yield_)();
    }

private:
    int* shared_;
    int threads_, phase_ = 0;
    Index yield_;
};

}  // namespace physreal

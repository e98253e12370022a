//! No allocation inside an analytic solver's step after warm-up.
//!
//! A profile of one environment does not show the cost of allocation. Only the stepping thread is counted, so memory of
//! a thread pool or of the test harness does not count. One thread steps 64 environments.

mod common;

use std::alloc::{GlobalAlloc, Layout, System as Heap};
use std::cell::Cell;

use common::*;

struct Counting;

thread_local! {
    static COUNT: Cell<usize> = const { Cell::new(0) };
}

// SAFETY: every call is forwarded unchanged to the system's allocator.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        // A thread that is ending has no counter any more.
        let _ = COUNT.try_with(|count| count.set(count.get() + 1));
        // SAFETY: the caller fulfils the trait's conditions.
        unsafe { Heap.alloc(layout) }
    }
    unsafe fn dealloc(&self, at: *mut u8, layout: Layout) {
        // SAFETY: `at` came from `alloc` above.
        unsafe { Heap.dealloc(at, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

#[test]
fn a_step_does_not_allocate() {
    for (robot, scene) in [
        ("cartpole", "free"),
        ("pendulum", "free"),
        ("pendulum", "ground1"),
        ("ant", "ground"),
        ("ant", "steps"),
        ("anymal", "box"),
    ] {
        let system = built_in(robot);
        for (name, config) in [
            ("paper", ArticulatedConfig::paper(&system, Friction::Coulomb)),
            ("explicit", ArticulatedConfig::explicit(16, Friction::Huber)),
            ("implicit", ArticulatedConfig::implicit(2, Friction::Coulomb)),
        ] {
            let mut batch = batch(&system, scene, 64);
            (0..64).for_each(|env| batch.reset(env, &start(&system, Start::Reset, &mut stream(0, env as u64))));
            let torques = vec![1.0; 64 * system.robot.joint_count()];
            let mut solver = Articulated::new(config);
            (0..3).for_each(|_| solver.step(&mut batch, &torques).expect("finite"));
            let before = COUNT.get();
            (0..200).for_each(|_| solver.step(&mut batch, &torques).expect("finite"));
            assert_eq!(COUNT.get() - before, 0, "{robot}, {scene}, {name}: allocations in 200 steps");
        }
    }
}

//! No allocation inside an analytic solver's step after warm-up: a simulator that allocates is slow in ways no profile of
//! one environment shows. Counted on one thread, since a thread pool's own bookkeeping is not the solver's.

use std::alloc::{GlobalAlloc, Layout, System as Heap};
use std::sync::atomic::{AtomicUsize, Ordering};

use nerd_sim::prelude::*;
use nerd_sim::sampling::{self, Start};

struct Counting;

static COUNT: AtomicUsize = AtomicUsize::new(0);

// SAFETY: every call is handed on to the system's allocator as it came.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        COUNT.fetch_add(1, Ordering::Relaxed);
        // SAFETY: the caller's promises are those of the trait.
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
    for (robot, scene) in [("cartpole", "free"), ("pendulum", "free"), ("pendulum", "ground1"), ("ant", "ground")] {
        let system = System::named(robot).expect("built in");
        for (name, config) in [
            ("paper", ArticulatedConfig::paper(&system, Friction::Coulomb)),
            ("explicit", ArticulatedConfig::explicit(16, Friction::Huber)),
            ("implicit", ArticulatedConfig::implicit(2, Friction::Coulomb)),
        ] {
            let mut batch = Batch::new(&system, &system.scene(scene).expect("scene"), 64);
            for env in 0..64 {
                batch.reset(env, &sampling::start(&system, Start::Reset, &mut sampling::stream(0, env as u64)));
            }
            let torques = vec![1.0; 64 * system.robot.joint_count()];
            let mut solver = Articulated::new(config);
            (0..3).for_each(|_| solver.step(&mut batch, &torques).expect("finite"));
            let before = COUNT.load(Ordering::Relaxed);
            (0..200).for_each(|_| solver.step(&mut batch, &torques).expect("finite"));
            let allocations = COUNT.load(Ordering::Relaxed) - before;
            assert_eq!(allocations, 0, "{robot}, {scene}, {name}: allocations in 200 steps");
        }
    }
}

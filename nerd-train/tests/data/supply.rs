//! Fresh data are the trajectories after the initial ones, added at updates that depend on the settings alone.

use nerd_train::prepare::{generate, normalize};

use crate::*;

const FRAMES: usize = 5;
const SHARD: usize = 4;
const SLOTS: usize = 3;

fn data(shards: usize) -> GenerateConfig {
    GenerateConfig {
        transitions: shards * SHARD * FRAMES,
        frames: FRAMES,
        shard_trajectories: SHARD,
        ..Default::default()
    }
}

fn solver() -> Box<dyn Solver> {
    let system = System::named("cartpole").unwrap();
    Box::new(Articulated::new(ArticulatedConfig::paper(&system, Friction::Coulomb)))
}

fn recorded(system: &Arc<System>, shards: usize) -> Windows {
    generate(system, &solver, &data(shards), (2, Form::default()), &|_| ()).unwrap().windows
}

/// Ten shards over a run of 100 updates, from `step` on.
fn config(data: GenerateConfig, normalizer: &Normalizer, step: u64) -> SupplyConfig {
    SupplyConfig {
        data,
        shards: 10,
        updates: 100,
        step,
        history: 2,
        form: Form::default(),
        normalizer: normalizer.clone(),
    }
}

fn supply(system: &Arc<System>, normalizer: &Normalizer, step: u64) -> Supply {
    Supply::new(system, solver, config(data(SLOTS), normalizer, step)).unwrap()
}

#[test]
fn takes_the_places_of_the_oldest() {
    let system = System::named("cartpole").unwrap();
    let mut all = recorded(&system, SLOTS + 10);
    let mut windows = recorded(&system, SLOTS);
    let normalizer = moments(&windows);
    normalize(&mut all, &normalizer);
    normalize(&mut windows, &normalizer);
    let mut supply = supply(&system, &normalizer, 0);
    let width = SHARD * FRAMES * windows.inputs;
    let mut taken = 0;
    for step in 0..=100 {
        while let Some(shard) = supply.take(step) {
            let (place, shard) = shard.unwrap();
            assert!(
                shard.x == all.x[(SLOTS + taken) * width..][..width],
                "shard {taken} is not what follows the start"
            );
            windows.replace(place, &shard).unwrap();
            taken += 1;
        }
        assert_eq!(taken, step as usize / 10, "shards taken by update {step}");
    }
    // Fresh shards 7, 8 and 9 are left, each in the slot of its number.
    for (slot, shard) in [(0, 9), (1, 7), (2, 8)] {
        assert!(windows.x[slot * width..][..width] == all.x[(SLOTS + shard) * width..][..width], "slot {slot}");
    }
    assert!(windows.replace(SHARD * SLOTS - 1, &all).is_err(), "what does not fit is refused");
}

#[test]
fn goes_on_where_it_was() {
    let system = System::named("cartpole").unwrap();
    let normalizer = moments(&recorded(&system, SLOTS));
    let at = |first: u64, step: u64| {
        let mut windows = recorded(&system, SLOTS);
        normalize(&mut windows, &normalizer);
        let mut supply = supply(&system, &normalizer, first);
        for now in first..=step {
            while let Some(shard) = supply.take(now) {
                let (place, shard) = shard.unwrap();
                windows.replace(place, &shard).unwrap();
            }
        }
        windows
    };
    for resumed in [5, 10, 39, 55, 99, 100] {
        assert!(at(0, 100).x == at(resumed, 100).x, "resumed at update {resumed}");
    }
}

#[test]
fn less_than_a_shard_is_refused() {
    let system = System::named("cartpole").unwrap();
    let normalizer = moments(&recorded(&system, SLOTS));
    let refused = |data: GenerateConfig| {
        let supply = Supply::new(&system, solver, config(data, &normalizer, 0));
        supply.err().map(|e| e.to_string()).unwrap_or_default()
    };
    let half = GenerateConfig { transitions: SHARD * FRAMES / 2, ..data(1) };
    assert!(refused(half).contains("less than a shard"));
    let none = GenerateConfig { shard_trajectories: 0, ..data(1) };
    assert!(refused(none).contains("shard_trajectories"));
}

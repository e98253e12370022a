//! Several ranks record the data that one records, and all end where one does.

mod common;

use std::time::Instant;

use common::*;
use nerd_train::prepare::generate;
use nerd_train::ranks::Place;

#[test]
fn sums_are_the_same_bits_everywhere_and_bytes_come_whole() {
    let number = |rank: usize, i: usize| ((1 + i * 7 + rank * 13) as f32).sin();
    let found = among(3, |ranks| {
        let mut sum: Vec<f32> = (0..300_000).map(|i| number(ranks.rank(), i)).collect();
        ranks.sum(&mut sum).expect("summed");
        let parts = (0..3).map(|from| ranks.share(from, || vec![from as u8; 1 << (10 * from)]).expect("shared")).collect::<Vec<_>>();
        ranks.wait().expect("all came");
        let decided = [true, false].map(|yes| ranks.decide(yes == ranks.leads()).expect("decided"));
        ranks.agree("words", "the same", "").expect("agreed");
        (sum, parts.iter().map(|p| (p[0], p.len())).collect::<Vec<_>>(), decided, ranks.part(10))
    });
    let expected: Vec<f32> = (0..300_000).map(|i| number(0, i) + number(1, i) + number(2, i)).collect();
    for (rank, (sum, parts, decided, part)) in found.into_iter().enumerate() {
        assert!(sum == expected, "rank {rank} has another sum");
        assert_eq!((parts, decided), (vec![(0, 1), (1, 1 << 10), (2, 1 << 20)], [true, false]), "rank {rank}");
        assert_eq!(part, [0..3, 3..6, 6..10][rank]);
    }
}

#[test]
fn data_are_shared_out_and_the_same() {
    let system = System::named("pendulum").expect("built in");
    let of = system.clone();
    let solver = move || -> Box<dyn Solver> { Box::new(Articulated::new(ArticulatedConfig::paper(&of, Friction::Coulomb))) };
    let data = GenerateConfig { transitions: 5 * 20, frames: 5, shard_trajectories: 4, ..Default::default() };
    let whole = generate(&Ranks::default(), &system, &solver, &data, (2, Form::default()), &|_| ()).expect("recorded");
    let normalizer = moments(&whole.windows);
    let supply = |ranks: &Arc<Ranks>, step| {
        let (data, normalizer, form) = (data.clone(), normalizer.clone(), Form::default());
        let config = SupplyConfig { data, shards: 12, updates: 24, step, history: 2, form, normalizer };
        let mut supply = Supply::new(ranks, &system, solver.clone(), config).expect("a supply");
        let mut all = Vec::new();
        for now in step..24 {
            while let Some(shard) = supply.take(now) {
                all.push(shard.map(|(place, windows)| (place, windows.x, windows.y)).expect("a shard"));
            }
        }
        all
    };
    let all = supply(&Arc::default(), 0);
    assert_eq!(all.len(), 11, "shards of one rank by the last update");
    for world in [2, 3] {
        let parts = among(world, |ranks| {
            let own = generate(ranks, &system, &solver, &data, (2, Form::default()), &|_| ()).expect("recorded");
            (own.windows.x, own.windows.y, own.sha256, [0, 13].map(|step| supply(ranks, step)))
        });
        for (rank, (x, y, sha256, [fresh, later])) in parts.into_iter().enumerate() {
            assert!((&x, &y, &sha256) == (&whole.windows.x, &whole.windows.y, &whole.sha256), "{world} ranks recorded something else");
            // Every R-th shard, from a rank's own number on, in the order of its own places.
            let own = all.iter().skip(rank).step_by(world).zip((0..5).cycle()).map(|((_, x, y), slot)| (4 * slot, x.clone(), y.clone()));
            let own: Vec<_> = own.take(fresh.len()).collect();
            assert!(fresh.len() >= 11 / world && fresh == own, "rank {rank} of {world} took up something else");
            assert!(!later.is_empty() && fresh.ends_with(&later), "rank {rank} of {world} goes on with something else");
        }
    }
}

#[test]
fn a_rank_that_fails_ends_the_others_with_its_reason() {
    let started = Instant::now();
    let found = among(4, |ranks| {
        if ranks.rank() == 2 {
            ranks.leave(Some("the disk is full"));
            return None;
        }
        let error = ranks.sum(&mut [1.0; 3]).expect_err("a rank is gone");
        ranks.leave(Some(&error.to_string()));
        Some(error.to_string())
    });
    println!("{:?} in {:.1} s", found[3], started.elapsed().as_secs_f64());
    for (rank, said) in found.into_iter().enumerate().filter(|(rank, _)| *rank != 2) {
        assert_eq!(said.as_deref(), Some("rank 2 of 4 ended: the disk is full"), "rank {rank}");
    }
    let found = among(2, |ranks| if ranks.leads() { ranks.wait().map_err(|e| e.to_string()) } else { Ok(()) });
    assert!(found[0].as_ref().is_err_and(|said| said.contains("rank 1 of 2 ended: it is done")), "{found:?}");
    let found = among(2, |ranks| ranks.sum(&mut vec![1.0; 3 + ranks.rank()]).map_err(|e| e.to_string()));
    assert!(found[0].as_ref().is_err_and(|said| said.contains("rank 1 has 4, this one 3")), "{found:?}");
}

#[test]
fn ranks_of_other_settings_do_not_begin() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let found = among(2, |ranks| {
        let mut run = RunConfig::recipe("quick", "pendulum", folder.path().join(format!("{}", ranks.rank()))).expect("shipped");
        (run.updates, run.transitions, run.fresh, run.batch) = (20, 400, 0, 8 + ranks.rank());
        let done = Run::new(&run).and_then(|run| run.among(ranks)).and_then(|run| run.train()).map_err(|e| e.to_string());
        ranks.leave(done.as_ref().err().map(String::as_str));
        done
    });
    for said in found.iter().map(|found| found.as_ref().expect_err("another batch")) {
        assert!(said.contains("settings differ from those of rank 0") && said.contains("`run.learner.batch` was 8, is 9 now"), "{said}");
    }
}

#[test]
fn every_wrong_variable_ends_in_a_line_with_its_name() {
    let good = [("RANK", "1"), ("WORLD_SIZE", "4"), ("LOCAL_RANK", "1"), ("MASTER_ADDR", "node7"), ("MASTER_PORT", "29500")];
    let with = |name: &str, value: Option<&str>| {
        Place::of(|asked| if asked == name { value } else { good.iter().find(|(n, _)| *n == asked).map(|(_, v)| *v) }.map(String::from))
    };
    let place = with("", None).expect("as torchrun sets them");
    assert_eq!((place.rank, place.world, place.local, place.address.as_str(), place.port), (1, 4, 1, "node7", 29500));
    assert_eq!(with("TORCHELASTIC_USE_AGENT_STORE", Some("True")).expect("torchrun holds the port").port, 29501);
    assert_eq!(Place::of(|_| None), Ok(Place::default()));
    let one = [("RANK", "0"), ("WORLD_SIZE", "1")];
    assert_eq!(Place::of(|asked| one.iter().find(|(n, _)| *n == asked).map(|(_, v)| v.to_string())), Ok(Place::default()));
    for (name, _) in good {
        let wrong = [None, Some(""), Some("-1"), Some("4"), Some("x"), Some("99999999999999999999")];
        // Addresses are tried, and some ports are 4.
        let wrong = wrong.iter().filter(|value| match name {
            "MASTER_ADDR" => value.is_none_or(str::is_empty),
            "MASTER_PORT" | "WORLD_SIZE" => **value != Some("4"),
            _ => true,
        });
        for value in wrong {
            let Err(RankError(said)) = with(name, *value) else { panic!("{name} may be {value:?}") };
            assert!(said.starts_with(name) && said.contains("needed") && !said.contains('\n'), "{name}={value:?}: {said}");
        }
    }
}

//! Shards on disk: complete or absent, the same bytes again after an interruption, never from other settings.

use std::{f64::consts::PI, path::Path};

use nerd_sim::dataset::{GenerateConfig, Manifest, generate, read_shard, record};
use nerd_sim::prelude::*;

use crate::common::{built_in, changed, line};

/// Half widths of the pendulum's sampling box: rad, rad, rad/s, rad/s (nerd-sim/assets/pendulum.toml).
const BOX: [f64; 4] = [PI, PI, 2.0 * PI, 4.0 * PI];

fn make(folder: &Path, seed: u64, frames: usize) -> Manifest {
    let system = built_in("pendulum");
    let torque_scale = Range { low: 0.0, high: 1.0 };
    let config = GenerateConfig {
        transitions: 100 * frames,
        frames,
        seed,
        shard_trajectories: 40,
        torque_scale,
        ..Default::default()
    };
    let mut truth = Articulated::new(ArticulatedConfig::paper(&system, Friction::Coulomb));
    generate(&system, &mut truth, "articulated paper coulomb", &config, folder, &mut |_, _| ()).expect("generated")
}

fn bytes(folder: &Path) -> Vec<(String, Vec<u8>)> {
    let mut files: Vec<_> = std::fs::read_dir(folder)
        .expect("folder")
        .map(|f| f.expect("file"))
        .map(|f| (f.file_name().into_string().expect("utf-8"), std::fs::read(f.path()).expect("read")))
        .collect();
    files.sort();
    files
}

#[test]
fn an_interrupted_generation_ends_with_the_bytes_of_an_unbroken_one() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let first = make(folder.path(), 3, 20);
    let whole = bytes(folder.path());
    assert_eq!(
        whole.iter().map(|f| f.0.as_str()).collect::<Vec<_>>(),
        ["manifest.json", "shard-00000.safetensors", "shard-00001.safetensors", "shard-00002.safetensors"]
    );
    // Damage by a crash or a disk: one shard gone, one cut short, the manifest lost.
    std::fs::remove_file(folder.path().join("shard-00000.safetensors")).expect("removed");
    std::fs::write(folder.path().join("shard-00001.safetensors"), &whole[2].1[..whole[2].1.len() / 2]).expect("cut");
    std::fs::remove_file(folder.path().join("manifest.json")).expect("removed");
    assert_eq!(make(folder.path(), 3, 20), first);
    assert!(bytes(folder.path()) == whole, "the files differ after the repair");
    // A single flipped bit is detected, too.
    let (path, mut damaged) = (folder.path().join("shard-00000.safetensors"), whole[1].1.clone());
    let last = damaged.len() - 9;
    damaged[last] ^= 1;
    std::fs::write(&path, damaged).expect("written");
    let error = line(read_shard(&path));
    assert!(error.contains("shard-00000.safetensors") && error.contains("SHA-256"), "{error}");
    assert_eq!(make(folder.path(), 3, 20), first, "its manifest is that of the undamaged one");
    assert!(bytes(folder.path()) == whole, "made anew to the byte");
}

#[test]
fn a_recording_holds_what_the_sampling_laws_say() {
    let folder = tempfile::tempdir().expect("temporary folder");
    make(folder.path(), 3, 20);
    let (mut touching, mut strongest) = (0, 0.0f64);
    for k in 0..3 {
        let (r, header) = read_shard(&folder.path().join(format!("shard-{k:05}.safetensors"))).expect("read");
        assert_eq!((header["robot"].as_str(), header["truth"].as_str()), ("pendulum", "articulated paper coulomb"));
        for t in 0..r.count {
            let s = &r.states[t * 21 * 4..];
            let inside = s.iter().zip(&BOX).all(|(x, half)| x.abs() <= half * 1.000_001);
            assert!(inside, "start {:?} outside the box {BOX:?}", &s[..4]);
        }
        strongest = r.torques.iter().fold(strongest, |a, b| a.max(b.abs()));
        touching += r.depths.iter().filter(|d| **d < 0.1).count();
        assert!(
            r.states.chunks_exact(4).all(|s| s[0].abs().max(s[1].abs()) <= BOX[0] * 1.000_001),
            "angles are wrapped"
        );
    }
    assert!((1000.0..=1500.0).contains(&strongest), "largest torque {strongest}, drawn from +-1500");
    assert!(touching > 50, "{touching} of 8000 points touch: the random planes are out of reach");
}

#[test]
fn held_actions_stay_for_as_many_frames_as_drawn_and_resets_start_in_their_box() {
    let system = built_in("ant");
    let mut truth = Articulated::new(ArticulatedConfig::paper(&system, Friction::Coulomb));
    let config = GenerateConfig { frames: 24, hold: 8, resets: 0.5, ..Default::default() };
    let r = record(&system, &mut truth, &config, 0, 64).expect("recorded");
    let mut runs = [0; 9];
    for t in 0..r.count {
        let torque = |f: usize| &r.torques[(t * 24 + f) * 8..][..8];
        let first =
            (1..24).find(|f| torque(*f) != torque(0)).expect("24 frames of one action, at most 8 were asked for");
        (1..24).for_each(|f| {
            assert_eq!(torque(f) != torque(f - 1), f % first == 0, "trajectory {t}, held {first}, frame {f}")
        });
        runs[first] += 1;
    }
    // Hold times are log-uniform over 1 to 8: expect `64 ln 2 / ln 9 = 20` trajectories with one frame an action, and
    // `64 ln (9 / 8) / ln 9 = 3.4` with eight.
    assert!(
        (10..=32).contains(&runs[1]) && runs[1..].iter().sum::<i32>() == 64 && runs[4..].iter().sum::<i32>() > 10,
        "{runs:?}"
    );
    // Resets start within 0.2 m of the origin, samples up to 10 m away.
    let d = system.robot.state_dim();
    let near = (0..64).filter(|t| [0, 2].iter().all(|axis| r.states[t * 25 * d + axis].abs() <= 0.2)).count();
    assert!((20..=44).contains(&near), "{near} of 64 start where episodes do, half were asked for");
}

/// The reuse key depends on the system's content, not on its name.
#[test]
fn shards_of_another_system_of_the_same_name_are_made_anew() {
    let (toml, urdf) = System::texts("cartpole").expect("built in");
    let make = |folder: &Path, toml: &str| {
        let system = std::sync::Arc::new(System::from_text("cartpole", urdf, Some(toml)).expect("valid"));
        let config = GenerateConfig { transitions: 60, frames: 10, shard_trajectories: 4, ..Default::default() };
        let mut truth = Articulated::new(ArticulatedConfig::paper(&system, Friction::Coulomb));
        let manifest = generate(&system, &mut truth, "paper", &config, folder, &mut |_, _| ()).expect("generated");
        (system, manifest)
    };
    let folder = tempfile::tempdir().expect("temporary folder");
    let (system, first) = make(folder.path(), toml);
    first.check(folder.path(), &system, "paper").expect("the same");
    assert_eq!(Manifest::read(folder.path()).expect("read"), first);
    for (from, to, what) in [
        ("-9.81", "-9.80", "gravity"),
        ("armature = 0.01", "armature = 0.02", "masses"),
        ("U(-3.5, 3.5)", "U(-3.5, 3.4)", "sampled"),
        ("torque = 1500.0", "torque = 1400.0", "driven"),
    ] {
        let (other, second) = make(folder.path(), &changed(toml, from, to));
        assert_ne!(second.sha256, first.sha256, "{to}: the old data are kept");
        let error = line(first.check(folder.path(), &other, "paper"));
        let named = [first.system_sha256.as_str(), first.robot_sha256.as_str()].iter().any(|hash| error.contains(hash))
            && [other.sha256(), other.robot_sha256()].iter().any(|hash| error.contains(hash));
        assert!(named && error.contains(what), "{to}: `{error}`");
        make(folder.path(), toml);
    }
    assert!(line(first.check(folder.path(), &system, "rapier")).contains("`rapier`"), "another truth");
    let mut columns = toml.replacen("\"theta\"", "\"angle\"", 1);
    columns.insert_str(0, "# another comment\n");
    assert_eq!(make(folder.path(), &columns).1, first, "names of columns are no part of the data");
}

/// Older data is reproduced: starts, torques and drawn parameters keep their draws, without `[vary]` and with its
/// oldest keys. The last bits of later states depend on the machine, so they are not compared.
#[test]
fn draws_stay_what_they_were() {
    let (toml, urdf) = System::texts("cartpole").expect("built in");
    let varied = format!("{toml}\n[vary]\nmass = \"U(0.5, 2)\"\narmature = \"U(0, 1)\"\n");
    let expected = [
        "3e5ad0c9c24d3afc2b08e9ed909dcfa7549bbfb20540cef4b6354a4ed7cd3de2",
        "91446d162d0877298567b71cf147bc7cb83f5b68f20f773fd43eafa02f207bb0",
    ];
    for (text, expected) in [toml, &varied].into_iter().zip(expected) {
        let system = Arc::new(System::from_text("cartpole", urdf, Some(text)).expect("it is right"));
        let config = GenerateConfig { transitions: 60, frames: 3, hold: 4, resets: 0.5, ..Default::default() };
        let made = record(&system, &mut Articulated::new(ArticulatedConfig::accurate(&system)), &config, 0, 20)
            .expect("recorded");
        let starts = made.states.chunks(4 * system.robot.state_dim()).flat_map(|row| &row[..system.robot.state_dim()]);
        let numbers: Vec<f64> = starts.chain(&made.torques).chain(&made.drawn).copied().collect();
        let found = nerd_sim::trajectories::Trajectories { states: numbers, ..Default::default() }.sha256();
        assert_eq!(nerd_sim::dataset::sha256_of([found]), expected);
    }
}

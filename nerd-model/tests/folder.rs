//! Model folders load unchanged or are refused: after any change of a file, a model that loads predicts as before.

mod common;

use std::path::Path;

use common::model;
use nerd_model::base::Base;
use nerd_model::folder::{Model, ModelConfig};
use nerd_model::transformer::{Architecture, Positions, Storage, TransformerConfig, Weights, packed};
use nerd_sim::prelude::*;
use rand::RngExt;
use tempfile::TempDir;

const FILES: [&str; 3] = ["config.json", "normalizer.json", "model.safetensors"];

fn pendulum() -> std::sync::Arc<System> {
    System::named("pendulum").expect("built in")
}

/// A folder with a model of the pendulum.
fn saved() -> TempDir {
    let folder = tempfile::tempdir().expect("temporary folder");
    model(&pendulum(), Base::State).save(folder.path(), "# card\n", Storage::F16).expect("saved");
    folder
}

/// The one-line reason for refusing a folder's model for a robot.
fn refusal(folder: &Path, system: &System, truth: Option<&str>) -> String {
    let error = Model::load(folder, system, truth).expect_err("refused").to_string();
    assert!(error.contains(&folder.display().to_string()) && !error.contains('\n'), "{error}");
    error
}

/// Whether two models predict the same.
fn alike(a: &Model, b: &Model) -> bool {
    let what = |m: &Model| (m.config.base, m.config.view, m.config.network);
    what(a) == what(b) && a.normalizer == b.normalizer && a.weights == b.weights
}

/// Sets a key of the folder's `config.json`, or of its network, and returns the refusal.
fn edit(folder: &Path, key: &str, value: &str) -> String {
    let path = folder.join("config.json");
    let mut config: serde_json::Value = serde_json::from_slice(&std::fs::read(&path).expect("read")).expect("JSON");
    let place = if config.get(key).is_some() { &mut config[key] } else { &mut config["network"][key] };
    *place = serde_json::from_str(value).expect("JSON");
    std::fs::write(&path, config.to_string()).expect("written");
    refusal(folder, &pendulum(), None)
}

#[test]
fn whatever_is_changed_loads_as_it_was_or_is_refused() {
    let folder = saved();
    let whole = Model::load(folder.path(), &pendulum(), None).expect("as it was written");
    let mut refused = 0;
    for (f, name) in FILES.into_iter().enumerate() {
        let path = folder.path().join(name);
        let bytes = std::fs::read(&path).expect("read");
        let mut rng = stream(7, f as u64);
        for case in 0..400 {
            let (mut changed, at) = (bytes.clone(), rng.random_range(0..bytes.len()));
            match case % 4 {
                0 => changed.truncate(at),
                1 => changed[at] ^= 1 << rng.random_range(0..8),
                2 => changed[at] = b"0123456789-.e{}[]\","[rng.random_range(0..19)],
                _ => changed.insert(at, rng.random_range(48..58)),
            }
            std::fs::write(&path, &changed).expect("written");
            match Model::load(folder.path(), &pendulum(), None) {
                Ok(found) => assert!(
                    alike(&found, &whole),
                    "{name}, case {case}, byte {at}: another model is taken for the saved one"
                ),
                Err(e) => {
                    assert!(!e.to_string().contains('\n'), "{name}, case {case}: `{e}` is not one line");
                    refused += 1;
                }
            }
        }
        std::fs::write(&path, bytes).expect("written");
    }
    assert!(refused > 800, "{refused} of 1200 changes refused");
}

#[test]
fn what_cannot_be_or_does_not_fit_is_refused_with_its_key() {
    // Possible values that contradict the other files.
    let cases = [
        ("inputs", "18446744073709551615", "`inputs`"),
        ("base", "\"trapezoid\"", "changed"),
        // Forms of earlier models.
        ("base", "\"nothing\"", "unknown variant `nothing`"),
        ("architecture", "\"gru\"", "unknown variant `gru`"),
        ("heads", "3", "changed"),
        ("history", "9", "changed"),
        ("layers", "1", "blocks.1"),
        ("robot_sha256", "null", "config.json"),
        ("robot_sha256", "\"\"", "masses"),
        ("model_sha256", "\"\"", "changed"),
    ];
    for (key, value, word) in cases {
        let error = edit(saved().path(), key, value);
        assert!(error.contains(word), "{key} {value}: {error}");
    }
    // Each number is possible by itself; together they give 13 billion parameters.
    let paper = TransformerConfig::paper(37, 4, 4096);
    let error = TransformerConfig { layers: 64, heads: 64, ..paper }.check().expect_err("too many");
    assert!(error.contains("parameters"), "{error}");
    let rotary = TransformerConfig { positions: Positions::Rotary, ..TransformerConfig::paper(37, 4, 60) };
    assert!(rotary.check().expect_err("5 columns a head").contains("`heads`"));
    // Heads and positions have no meaning without attention.
    let residual = TransformerConfig { architecture: Architecture::Residual, heads: 1, embedding: 97, ..rotary };
    residual.check().expect("a residual network of any width");
}

/// Shapes at the limits are refused with a key, or predict finite numbers.
#[test]
fn a_shape_that_is_not_refused_predicts() {
    let (mut rng, mut refused, mut run) = (stream(3, 0), 0, 0);
    for case in 0..20_000 {
        let mut draw = |few: usize| if rng.random_range(0..24) == 0 { 0 } else { rng.random_range(1..=few) };
        let (inputs, outputs, embedding, layers) = (draw(5), draw(5), draw(16), draw(3));
        let (heads, block, history, head) = (draw(8), draw(6), draw(4), draw(5));
        let positions = common::POSITIONS[rng.random_range(0..2)];
        let all = [Architecture::Transformer, Architecture::Residual, Architecture::Chain];
        let architecture = all[rng.random_range(0..if case % 2 == 0 { 1 } else { 3 })];
        let config = TransformerConfig {
            inputs,
            outputs,
            embedding,
            layers,
            heads,
            block,
            history,
            head,
            positions,
            architecture,
        };
        if let Err(reason) = config.check() {
            assert!(reason.starts_with('`') && !reason.contains('\n'), "{config:?}: {reason}");
            refused += 1;
            continue;
        }
        let (mut network, mut out) = (packed(&Weights::init(config, case)), Vec::new());
        for frame in 0..6 {
            network.push(&vec![0.3 * frame as f32; 2 * inputs], &mut out).expect("a frame");
            assert!(
                out.len() == 2 * outputs && out.iter().all(|x| x.is_finite()),
                "{config:?}, frame {frame}: {out:?}"
            );
        }
        run += 1;
    }
    assert!(refused > 2000 && run > 2000, "{refused} shapes refused, {run} predict");
}

fn huge(model: &mut Model, tensor: &str) {
    let before: usize = model.weights.iter().take_while(|(t, _)| t.name != tensor).map(|(t, _)| t.len()).sum();
    model.weights.flat[before] = 1e6;
}

#[test]
fn what_is_no_number_is_refused_with_its_place() {
    let folder = tempfile::tempdir().expect("temporary folder");
    type Change<'a> = &'a dyn Fn(&mut Model);
    let cases: [(Change, Storage, [&str; 2]); 4] = [
        (&|m| m.weights.flat[3] = f32::NAN, Storage::F32, ["`embed.weight`", "entry 3 is NaN"]),
        // Beyond the range of f16 (ten bits of mantissa, five of exponent).
        (&|m| huge(m, "blocks.0.attn.qkv.weight"), Storage::F16, ["`blocks.0.attn.qkv.weight`", "entry 0 is inf"]),
        (&|m| m.normalizer.outputs.variance[1] = -1e-6, Storage::F32, ["normalizer.json", "`variance` 1"]),
        (&|m| m.normalizer.inputs.mean.truncate(2), Storage::F32, ["normalizer.json", "`mean`"]),
    ];
    for (change, storage, words) in cases {
        let mut model = model(&pendulum(), Base::State);
        change(&mut model);
        let saved = model.save(folder.path(), "# card\n", storage);
        let error =
            saved.and_then(|()| Model::load(folder.path(), &pendulum(), None)).expect_err("no number").to_string();
        assert!(words.iter().all(|word| error.contains(word)), "{error}");
    }
}

#[test]
fn a_robot_of_the_same_name_is_not_the_same_robot() {
    let (folder, (spec, urdf)) = (saved(), System::texts("pendulum").expect("built in"));
    let same = System::from_text("pendulum", urdf, Some(spec)).expect("valid");
    Model::load(folder.path(), &same, None).expect("the same robot from its files");
    let lighter = System::from_text("pendulum", &urdf.replacen("mass value=\"25", "mass value=\"2", 1), Some(spec))
        .expect("valid");
    let error = refusal(folder.path(), &lighter, None);
    let hashes = [same.robot_sha256(), lighter.robot_sha256()];
    assert!(hashes.iter().all(|h| error.contains(&h[..12])) && error.contains("masses"), "{error}");
    let mut model = Model::read(folder.path(), &lighter, None).expect("read without a look at hashes");
    model.config.robot_sha256 = lighter.robot_sha256();
    model.save(folder.path(), "# card\n", Storage::F16).expect("saved");
    Model::load(folder.path(), &lighter, None).expect("stamped");
}

#[test]
fn a_folder_cut_off_while_it_was_written_is_none() {
    let (old, new) = (saved(), saved());
    let mut model = model(&pendulum(), Base::State);
    model.weights.flat[0] += 1.0;
    model.save(new.path(), "# card\n", Storage::F16).expect("saved");
    // Files are replaced in this order.
    for name in ["normalizer.json", "README.md", "model.safetensors"] {
        std::fs::copy(new.path().join(name), old.path().join(name)).expect("copied");
    }
    let error = refusal(old.path(), &pendulum(), None);
    assert!(error.contains("changed"), "{error}");
    std::fs::remove_file(old.path().join("config.json")).expect("removed");
    let error = refusal(old.path(), &pendulum(), None);
    assert!(error.contains("config.json"), "{error}");
    // Saving leaves no other files beside the folder.
    let fresh = new.path().join("fresh");
    model.save(&fresh, "# card\n", Storage::F16).expect("saved");
    Model::load(&fresh, &pendulum(), None).expect("as it was written");
    let beside = std::fs::read_dir(new.path()).expect("read").count();
    assert_eq!(beside, 5, "four files and the folder");
}

/// Shipped models are complete, for built-in robots, with known truths. The truth of a robot `NAME-paper` is the
/// reference simulator's preset.
#[test]
fn shipped_models_are_of_built_in_robots_and_known_truths() {
    let models = Path::new(env!("CARGO_MANIFEST_DIR")).join("../models");
    let below = |folder: &Path| {
        std::fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path()).collect::<Vec<_>>()
    };
    let all = below(&models).into_iter().filter(|folder| folder.join("config.json").exists());
    for folder in all {
        let config = ModelConfig::read(&folder).expect("a card");
        let system = System::named(&config.robot).unwrap_or_else(|error| panic!("{}: {error}", folder.display()));
        Model::load(&folder, &system, Some(&config.truth)).unwrap_or_else(|error| panic!("{error}"));
        let truth = Truth::named(&config.truth).unwrap_or_else(|error| panic!("{}: {error}", folder.display()));
        let paper = config.robot.ends_with("-paper");
        assert_eq!(truth == Truth::Paper, paper, "{}: {} learned `{}`", folder.display(), config.robot, config.truth);
    }
}

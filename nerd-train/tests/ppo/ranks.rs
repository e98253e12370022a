//! Several ranks learn what one learns: the same episodes, and weights that are equal everywhere and those of one to rounding.

use crate::*;

#[test]
fn policies_do_not_depend_on_the_number_of_ranks() {
    // The rate is left alone: a rounding may carry a divergence across its threshold.
    ranks_learn_alike(PpoConfig { environments: 11, minibatch: 50, kl: 0.0, stack: 2, ..config("") }, Setting::Paper);
}

#[test]
fn nor_do_those_that_learn_from_slopes() {
    ranks_learn_alike(PpoConfig { environments: 11, minibatch: 50, ..config("algorithm = \"shac\"") }, Setting::Rk4(2));
}

fn ranks_learn_alike(config: PpoConfig, setting: Setting) {
    let folder = tempfile::tempdir().expect("temporary folder");
    let file = folder.path().join("last.safetensors");
    let begin = |ranks: &Arc<Ranks>| {
        let (task, part) = (named("cartpole-swingup").expect("registered"), ranks.part(config.environments));
        let own = Arena::Judge(setting.clone()).part(task, part, 3).expect("episodes");
        Trainer::among(ranks, own, config.clone(), 9).expect("fits")
    };
    let steps = |trainer: &mut Trainer, n: usize| (0..n).map(|_| trainer.iterate().expect("goes on")).last().expect("an iteration");
    let mut alone = begin(&Arc::default());
    let line = steps(&mut alone, 6);
    for world in [2, 3] {
        let found = among(world, |ranks| {
            let mut trainer = begin(ranks);
            steps(&mut trainer, 3);
            trainer.save(&file, "a run").expect("saved");
            ranks.wait().expect("all came");
            let mut again = begin(ranks);
            again.resume(&file, "a run").expect("its own file");
            ranks.wait().expect("all came");
            let line = steps(&mut again, 3);
            let learned: Vec<f32> = again.engine.learned().expect("numbers").into_iter().flat_map(|(_, numbers)| numbers.clone()).collect();
            (line.episodes, line.reward, again.state.policy, again.state.recent, learned)
        });
        let off = found[0].2.flat.iter().zip(&alone.state.policy.flat).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        println!("{world} ranks: weights {off:.1e} from those of one after six iterations");
        assert!(off < 1e-3, "{world} ranks: weights {off:.1e} from those of one");
        assert!(found.iter().all(|other| *other == found[0]), "{world} ranks came to different policies");
        assert_eq!(found[0].0, line.episodes, "{world} ranks: episodes that ended");
        assert_eq!(found[0].3.len(), alone.state.recent.len(), "{world} ranks: episodes so far");
    }
}

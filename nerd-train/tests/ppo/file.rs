//! Policies of tasks from files: what is played is the text that was learned with.

use nerd_sim::truth::Truth;

use super::*;

const TASK: &str = "
robot = \"cartpole\"
steps = 20
observation = [\"q\", \"qd\", \"action\"]
actions = 1
act = \"[400 * action, 0]\"
reward = \"1 - q[1].squared()\"
";

#[test]
fn a_policy_is_played_by_the_text_it_learned_with() {
    let temporary = tempfile::tempdir().expect("temporary folder");
    let (file, out) = (temporary.path().join("mine.toml"), temporary.path().join("run"));
    let write = |text: &str| std::fs::write(&file, text).expect("written");
    let task = file.display().to_string();
    let run = |iterations: u64| {
        let config = PpoConfig { iterations, ..config("") };
        let arena = Arena::Truth(Truth::Articulated);
        PolicyRun { task: task.clone(), arena, config, seed: 0, minutes: None, out: out.clone() }.train()
    };
    write(TASK);
    run(1).expect("trains");
    let learned = run(2).expect("goes on");
    assert_eq!(learned.iterations, 2);
    // Later the file asks for something else, and sees less.
    write(&TASK.replace("[\"q\", \"qd\", \"action\"]", "[\"q\"]").replace("1 - ", "2 - "));
    let (found, _) = folder::load(&learned.policy).expect("its folder");
    let (kept, changed) = (named(&found.task).expect("kept"), named(&task).expect("changed"));
    assert_eq!((kept.observation_dim(), changed.observation_dim(), kept.text()), (5, 2, Some(TASK)));
    let episodes = Arena::Truth(Truth::Articulated).episodes(&found.task, 2, 0).expect("episodes");
    assert_eq!(episodes.observations().len(), 10);
    let said = folder::load_for(&learned.policy, &*changed).err().map(|e| e.to_string()).unwrap_or_default();
    assert!(said.contains("a policy of task"), "{said}");
    let said = run(3).err().map(|e| e.to_string()).unwrap_or_default();
    assert!(said.ends_with("another run: the task's text changed"), "{said}");
    // And with another robot it is refused.
    let kept = learned.policy.join("task.toml");
    std::fs::write(&kept, TASK.replace("\"cartpole\"", "\"pendulum\"")).expect("written");
    let said = folder::load(&learned.policy).err().map(|e| e.to_string()).unwrap_or_default();
    assert!(said.contains("robot `pendulum`, or what the task says of robots"), "{said}");
}

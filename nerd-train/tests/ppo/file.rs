//! Policies of tasks from files: a policy is evaluated with the task text that it was trained with.

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
        let arena = Arena::Solver(SolverSpec::default());
        PolicyRun { task: task.clone(), arena, config, seed: 0, minutes: None, out: out.clone() }.train()
    };
    write(TASK);
    run(1).expect("trains");
    let learned = run(2).expect("goes on");
    assert_eq!(learned.iterations, 2);
    // The file's task now has another reward and a smaller observation.
    write(&TASK.replace("[\"q\", \"qd\", \"action\"]", "[\"q\"]").replace("1 - ", "2 - "));
    let (found, _) = folder::load(&learned.policy).expect("its folder");
    let (kept, changed) = (named(&found.task).expect("kept"), named(&task).expect("changed"));
    assert_eq!((kept.observation_dim(), changed.observation_dim(), kept.text()), (5, 2, Some(TASK)));
    let episodes = Arena::Solver(SolverSpec::default()).episodes(&found.task, 2, 0).expect("episodes");
    assert_eq!(episodes.observations().len(), 10);
    let said = folder::load_for(&learned.policy, &*changed).err().map(|e| e.to_string()).unwrap_or_default();
    assert!(said.contains("a policy of task"), "{said}");
    let said = run(3).err().map(|e| e.to_string()).unwrap_or_default();
    assert!(said.ends_with("another run: the task's text changed"), "{said}");
    // With another robot in the kept text, the policy is refused.
    let kept = learned.policy.join("task.toml");
    std::fs::write(&kept, TASK.replace("\"cartpole\"", "\"pendulum\"")).expect("written");
    let said = folder::load(&learned.policy).err().map(|e| e.to_string()).unwrap_or_default();
    assert!(said.contains("robot `pendulum`, or what the task says of robots"), "{said}");
}

/// The method `paper` steps the robot that is named; the truth `paper` is that method on the reference's robot.
#[test]
fn a_method_steps_the_named_robot_and_the_truth_paper_its_own() {
    let robot = |arena: Arena| arena.episodes("ant-run", 1, 0).expect("episodes").simulation.batch.system.name.clone();
    assert_eq!(robot(Arena::Solver(Truth::Paper.into())), "ant");
    assert_eq!(robot(Arena::from(Truth::Paper)), "ant-paper");
    assert_eq!(robot(Arena::from(Truth::Articulated)), "ant");
    let family = |spec| Arena::family("ant-run", "ant-family", spec).expect("a family").word();
    assert_eq!(family(SolverSpec::default()), "ant-family-articulated");
    assert_eq!(family(SolverSpec::implicit(2)), "ant-family-articulated-substeps-2");
}

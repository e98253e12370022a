//! `rollout`'s table of starts: what is wrong in it is one line and no file; nothing but starts needs `--frames`.

mod common;

use common::{refused, xtask};

#[test]
fn a_table_is_rolled_out_or_refused_without_output() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let (file, out) = (folder.path().join("states.csv"), folder.path().join("out.csv"));
    let [states, place] = [&file, &out].map(|path| path.to_str().expect("utf-8"));
    let args = ["rollout", "--robot", "pendulum", "--states", states, "--out", place];
    let header = "traj,step,q1,q2,qd1,qd2";
    for (rows, words) in [
        ("0,0,0,inf,0,0\n", ["states.csv", "line 2, column `q2`"]),
        ("0,0,0,0,0,0\n", ["states.csv", "--frames"]),
        ("0,0,0,0,0,0\n0,1000000,,,,\n", ["states.csv", "only 2 rows"]),
    ] {
        std::fs::write(&file, format!("{header}\n{rows}")).expect("written");
        words.iter().for_each(|word| refused(&args, word));
        assert!(!out.exists(), "{rows} left a file");
    }
    std::fs::write(&file, format!("{header}\n7,0,0.1,0.2,0,0\n7,1,,,,\n")).expect("written");
    let run = xtask(&args);
    assert!(run.status.success(), "{}", String::from_utf8_lossy(&run.stderr));
    let text = std::fs::read_to_string(out).expect("a table");
    assert!(text.starts_with(&format!("{header}\n7,0,0.1,0.2,0,0\n7,1,")) && text.lines().count() == 3, "{text}");
}

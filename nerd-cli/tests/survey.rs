//! Unknown robots from their URDFs alone: which load, and whether they stand, hang or fall.

use std::path::Path;

use nerd_cli::survey::{Found, beside, find, survey, verdict};
use nerd_sim::prelude::System;

/// A table of 9 kg on four legs of 0.25 kg, each turning about a hinge along y.
fn table(lower: f64) -> String {
    let inertia = r#"<inertia ixx="0.02" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/>"#;
    let mut text = format!(
        r#"<robot name="table"><link name="top"><inertial><mass value="9"/>{inertia}</inertial>
        <collision><geometry><box size="0.6 0.4 0.05"/></geometry></collision></link>"#
    );
    for (k, (x, y)) in [(0.25, 0.15), (0.25, -0.15), (-0.25, 0.15), (-0.25, -0.15)].into_iter().enumerate() {
        text += &format!(
            r#"<link name="leg{k}"><inertial><origin xyz="0 0 -0.15"/><mass value="0.25"/>
            <inertia ixx="0.002" iyy="0.002" izz="0.0001" ixy="0" ixz="0" iyz="0"/></inertial>
            <collision><origin xyz="0 0 -0.15"/><geometry><box size="0.03 0.03 0.3"/></geometry></collision></link>
            <joint name="hip{k}" type="revolute"><parent link="top"/><child link="leg{k}"/><origin xyz="{x} {y} 0"/>
            <axis xyz="0 1 0"/><limit lower="{lower}" upper="1.5" effort="40" velocity="20"/></joint>"#
        );
    }
    text + "</robot>"
}

/// Writes a URDF to a folder and finds it there.
fn written(folder: &Path, name: &str, text: &str) -> Found {
    std::fs::write(folder.join(name), text).expect("written");
    find(&folder.join(name)).expect("it is there").remove(0)
}

#[test]
fn a_pose_beside_the_urdf_is_taken() {
    let folder = tempfile::tempdir().expect("a folder");
    for name in ["urdf", "srdf"] {
        std::fs::create_dir(folder.path().join(name)).expect("a folder");
    }
    // Zero lies outside these limits.
    let found = written(&folder.path().join("urdf"), "table.urdf", &table(0.1));
    let notes = || System::named(&found.path.display().to_string()).expect("a robot").notes.join(" ");
    assert!(notes().contains("pose zero, within the limits"), "{}", notes());
    let pose = r#"<robot name="table"><group_state name="standing" group="all"><joint name="root" value="0 0 1"/>
        <joint name="hip0" value="0.2"/><joint name="hip1" value="0.2"/><joint name="hip2" value="0.2"/></group_state></robot>"#;
    std::fs::write(folder.path().join("srdf/table.srdf"), pose).expect("a file");
    std::fs::write(folder.path().join("srdf/broken.srdf"), "<robot").expect("a file");
    assert!(notes().contains("pose `standing` of table.srdf"), "{}", notes());
}

#[test]
fn a_file_that_is_no_text_has_its_line_and_the_others_their_turn() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let write = |name: &str, bytes: &[u8]| std::fs::write(folder.path().join(name), bytes).expect("written");
    let good = r#"<robot name="r"><link name="a"/><link name="b"><inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link><joint name="j" type="continuous"><parent link="a"/><child link="b"/><axis xyz="0 1 0"/></joint></robot>"#;
    std::fs::create_dir(folder.path().join("below")).expect("made");
    write("a.urdf", b"<robot name=\"\xff\xfe\"/>");
    write("below/b.urdf", good.as_bytes());
    write("c.urdf", b"no xml");
    write("d.xml", good.as_bytes());
    let found = find(folder.path()).expect("a folder");
    assert_eq!(found.iter().map(|f| f.name.as_str()).collect::<Vec<_>>(), ["a.urdf", "below/b.urdf", "c.urdf"]);
    let [a, b, c] = [0, 1, 2].map(|k| survey(&found[k]));
    assert_eq!(a.fixed, Err("is not UTF-8 text: byte 13".into()));
    assert_eq!((b.fixed.as_ref().ok(), b.sizes.map(|s| (s.joints, s.mass))), (Some(&4), Some((1, 1.0))), "{b:?}");
    assert!(b.floating.is_err() && c.fixed.is_err() && c.sizes.is_none(), "{b:?} {c:?}");
    assert!(find("/nowhere".as_ref()).is_err());
}

/// A chain of `n` hinges, 0.1 m apart, with axes alternating between y and x.
fn chain(n: usize) -> String {
    let inertial = r#"<inertial><origin xyz="0 0 -0.05"/><mass value="0.1"/><inertia ixx="1e-4" iyy="1e-4" izz="1e-5" ixy="0" ixz="0" iyz="0"/></inertial>"#;
    let piece = |k: usize| {
        let axis = if k.is_multiple_of(2) { "0 1 0" } else { "1 0 0" };
        format!(
            r#"<link name="l{}">{inertial}</link><joint name="j{k}" type="revolute"><parent link="l{k}"/><child link="l{}"/><origin xyz="0 0 -0.1"/>
            <axis xyz="{axis}"/><limit lower="-1" upper="1" effort="100" velocity="10"/></joint>"#,
            k + 1,
            k + 1
        )
    };
    format!(r#"<robot name="chain"><link name="l0">{inertial}</link>{}</robot>"#, (0..n).map(piece).collect::<String>())
}

#[test]
fn a_thousand_links_take_seconds() {
    let folder = tempfile::tempdir().expect("a folder");
    let (found, start) = (written(folder.path(), "chain.urdf", &chain(1000)), std::time::Instant::now());
    let robot = survey(&found);
    let seconds = start.elapsed().as_secs_f64();
    assert!(robot.fixed.is_ok() && robot.floating.is_ok(), "{robot:?}");
    assert!(seconds < 60.0, "{seconds} s");
}

#[test]
fn a_newcomer_is_told_whether_a_robot_stands_hangs_or_falls() {
    let folder = tempfile::tempdir().expect("a folder");
    let ball = r#"<robot name="ball"><link name="ball"><inertial><mass value="1"/><inertia ixx="0.004" iyy="0.004" izz="0.004" ixy="0" ixz="0" iyz="0"/></inertial>
        <collision><geometry><sphere radius="0.1"/></geometry></collision></link></robot>"#;
    let arm = chain(2).replacen(
        "<joint",
        r#"<link name="w"/><joint name="f" type="fixed"><parent link="w"/><child link="l0"/></joint><joint"#,
        1,
    );
    for (name, text, words) in [
        ("table", table(-1.5), &["joints held by drives, it stands (root 0.29", "0.3000 m at the start"][..]),
        ("lean", table(0.2), &["held by drives, it stands", "limp, it falls"]),
        ("ball", ball.into(), &["it stands (root 0.099", "0.1000 m at the start, tilted by 0.0 deg"]),
        ("bare", ball.replace("collision", "visual"), &["nothing to touch"]),
        ("arm", arm, &["it hangs still (`j", "limp, it hangs still"]),
        ("chain", chain(1000), &["not tried: with 1000 degrees"]),
    ] {
        let found = written(folder.path(), &format!("{name}.urdf"), &text);
        let line = verdict(&System::named(&found.path.display().to_string()).expect("a robot"), 1.0);
        assert!(words.iter().all(|word| line.contains(word)) && !line.contains('\n'), "{name}: {line}");
    }
}

/// With a MuJoCo (`NERD_MUJOCO`): a file is read as by MuJoCo, or its row names the difference or the refusal.
#[test]
fn a_file_beside_mujoco_is_equal_or_says_why_not() {
    let Some(python) = std::env::var("NERD_MUJOCO").ok() else { return println!("skipped: no MuJoCo") };
    let folder = tempfile::tempdir().expect("a folder");
    let write = |name: &str, joint: &str, world: &str| {
        let text = format!(
            r#"<mujoco><asset><hfield name="hill" nrow="2" ncol="2" size="1 1 1 1"/></asset><worldbody>{world}
            <body name="b"><joint axis="0 1 0" {joint}/><geom name="ball" size=".1" pos=".3 0 0"/></body></worldbody></mujoco>"#
        );
        std::fs::write(folder.path().join(name), text).expect("a file");
    };
    write(
        "a.xml",
        "",
        r#"<geom type="plane" size="1 1 1" friction="2"/><geom type="hfield" hfield="hill" pos="0 0 -1"/>"#,
    );
    // Tangential friction 1 and 0.5 becomes one coefficient here, 0.75.
    let pair = r#"<contact><pair geom1="floor" geom2="ball" friction="1 .5"/></contact>"#;
    write("b.xml", "", &format!(r#"<geom name="floor" type="plane" size="1 1 1"/></worldbody>{pair}<worldbody>"#));
    write("c.xml", r#"type="ball""#, "");
    write("d.xml", r#"damping="no""#, "");
    let table = beside(&find(folder.path()).expect("files"), Path::new(&python));
    let verdicts: Vec<&str> = table.rows.iter().filter_map(|row| row.last()).map(String::as_str).collect();
    assert_eq!(verdicts.len(), 4, "{verdicts:?}");
    assert_eq!(verdicts[0], "equal");
    for (verdict, words) in
        verdicts[1..].iter().zip(["`floor` and `ball`: friction 0.750 here", "refused: ", "refused: "])
    {
        assert!(verdict.contains(words), "{words}: {verdicts:?}");
    }
    assert!(table.note.starts_with("4 files: 2 load; of 1 "), "{}", table.note);
}

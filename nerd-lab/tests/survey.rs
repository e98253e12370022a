//! Other people's robots, from their URDFs alone: read, and on their own feet.

use std::path::Path;

use nerd_lab::survey::{Found, find, stand, survey};

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

/// The URDF of a robot as a file in a folder.
fn written(folder: &Path, name: &str, text: &str) -> Found {
    std::fs::write(folder.join(name), text).expect("written");
    find(&folder.join(name)).expect("it is there").remove(0)
}

#[test]
fn a_table_stands_and_falls() {
    let folder = tempfile::tempdir().expect("a folder");
    let standing = stand(&written(folder.path(), "table.urdf", &table(-1.5)), None).expect("it stands");
    assert_eq!((standing.points, standing.mujoco.is_none()), (40, true));
    assert!((standing.start - 0.3).abs() < 1e-4, "begins at {} m", standing.start);
    let [height, tilt] = standing.ours[599];
    // 10 kg on four legs of at least 1e5 N/m a corner.
    assert!((0.299..0.3).contains(&height), "stands at {height} m, legs of 0.3 m");
    assert!(tilt < 1e-3, "leans by {tilt} rad");
    // Upright legs balance on their feet; leaning ones do not.
    let limp = stand(&written(folder.path(), "table.urdf", &table(0.2)), None).expect("it stands").limp;
    assert!(limp.lost > 15.0, "lost {} J, it should fall by most of a leg", limp.lost);
    assert!(limp.rise < 1e-3 * limp.lost, "energy rose by {} J of {} J", limp.rise, limp.lost);
    assert!(limp.deepest < 0.02, "{} m under the ground", limp.deepest);
    let bare = written(folder.path(), "bare.urdf", &table(-1.5).replace("collision>", "visual>"));
    let error = stand(&bare, None).expect_err("it touches nothing").to_string();
    assert!(error.contains("nothing to touch the ground"), "{error}");
}

#[test]
fn a_pose_beside_the_urdf_is_taken() {
    let folder = tempfile::tempdir().expect("a folder");
    for name in ["urdf", "srdf"] {
        std::fs::create_dir(folder.path().join(name)).expect("a folder");
    }
    // Zero lies outside these limits.
    let found = written(&folder.path().join("urdf"), "table.urdf", &table(0.1));
    assert_eq!(stand(&found, None).expect("it stands").pose, "zero, within the limits");
    let pose = r#"<robot name="table"><group_state name="standing" group="all"><joint name="root" value="0 0 1"/>
        <joint name="hip0" value="0.2"/><joint name="hip1" value="0.2"/><joint name="hip2" value="0.2"/></group_state></robot>"#;
    std::fs::write(folder.path().join("srdf/table.srdf"), pose).expect("a file");
    std::fs::write(folder.path().join("srdf/broken.srdf"), "<robot").expect("a file");
    let standing = stand(&found, None).expect("it stands");
    assert_eq!(standing.pose, "`standing` of table.srdf");
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

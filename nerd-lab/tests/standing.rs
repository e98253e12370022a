//! A robot on its own feet, from its URDF alone.

use nerd_lab::survey::{find, stand};

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

#[test]
fn a_table_stands_and_falls() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("table.urdf");
    std::fs::write(&path, table(-1.5)).expect("a file");
    let found = find(&path).expect("it is there");
    let standing = stand(&found[0], None).expect("it stands");
    assert_eq!((standing.points, standing.mujoco.is_none()), (40, true));
    assert!((standing.start - 0.3).abs() < 1e-4, "begins at {} m", standing.start);
    let [height, tilt] = standing.ours[599];
    // 10 kg on four legs of at least 1e5 N/m a corner.
    assert!((0.299..0.3).contains(&height), "stands at {height} m, legs of 0.3 m");
    assert!(tilt < 1e-3, "leans by {tilt} rad");
    // Upright legs balance on their feet; leaning ones do not.
    std::fs::write(&path, table(0.2)).expect("a file");
    let limp = stand(&found[0], None).expect("it stands").limp;
    assert!(limp.lost > 15.0, "lost {} J, it should fall by most of a leg", limp.lost);
    assert!(limp.rise < 1e-3 * limp.lost, "energy rose by {} J of {} J", limp.rise, limp.lost);
    assert!(limp.deepest < 0.02, "{} m under the ground", limp.deepest);
}

#[test]
fn a_pose_beside_the_urdf_is_taken() {
    let folder = tempfile::tempdir().expect("a folder");
    for name in ["urdf", "srdf"] {
        std::fs::create_dir(folder.path().join(name)).expect("a folder");
    }
    // Zero lies outside these limits.
    let path = folder.path().join("urdf/table.urdf");
    std::fs::write(&path, table(0.1)).expect("a file");
    let found = find(&path).expect("it is there");
    assert_eq!(stand(&found[0], None).expect("it stands").pose, "zero, within the limits");
    let pose = r#"<robot name="table"><group_state name="standing" group="all"><joint name="root" value="0 0 1"/>
        <joint name="hip0" value="0.2"/><joint name="hip1" value="0.2"/><joint name="hip2" value="0.2"/></group_state></robot>"#;
    std::fs::write(folder.path().join("srdf/table.srdf"), pose).expect("a file");
    std::fs::write(folder.path().join("srdf/broken.srdf"), "<robot").expect("a file");
    let standing = stand(&found[0], None).expect("it stands");
    assert_eq!(standing.pose, "`standing` of table.srdf");
}

#[test]
fn what_cannot_stand_has_a_line() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("bare.urdf");
    let text = table(-1.5).replace("collision>", "visual>");
    std::fs::write(&path, text).expect("a file");
    let found = find(&path).expect("it is there");
    let said = stand(&found[0], None).expect_err("it touches nothing").to_string();
    assert!(said.contains("nothing to touch the ground"), "{said}");
}

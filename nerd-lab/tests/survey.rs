//! Other people's robots: one file that nobody can read is one honest line, not the end of the others' turn.

use nerd_lab::survey::{find, survey};

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

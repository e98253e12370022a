//! `urdf` over a folder: one file that nobody can read is one honest line, not the end of the others' turn.

mod common;

use common::{refused, xtask};

#[test]
fn a_file_that_is_no_text_has_its_line_and_the_others_their_turn() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let write = |name: &str, bytes: &[u8]| std::fs::write(folder.path().join(name), bytes).expect("written");
    let good = r#"<robot name="r"><link name="a"/><link name="b"><inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link><joint name="j" type="continuous"><parent link="a"/><child link="b"/><axis xyz="0 1 0"/></joint></robot>"#;
    write("a.urdf", b"<robot name=\"\xff\xfe\"/>");
    write("b.urdf", good.as_bytes());
    write("c.urdf", b"no xml");
    let run = xtask(&["urdf", folder.path().to_str().expect("utf-8")]);
    let said = String::from_utf8_lossy(&run.stdout);
    assert!(run.status.success(), "{}", String::from_utf8_lossy(&run.stderr));
    let line = |name: &str| said.lines().find(|l| l.contains(name)).unwrap_or_else(|| panic!("no line of {name}:\n{said}"));
    assert!(line("a.urdf").contains("is not UTF-8 text: byte 13"), "{said}");
    assert!(line("b.urdf").contains("| ok"), "{said}");
    assert!(!line("c.urdf").contains("| ok"), "{said}");
    assert!(said.contains("3 files: 1 move on a fixed base"), "{said}");
    refused(&["urdf", "/nowhere"], "/nowhere");
}

//! `urdf` over a folder: a line a file, and the sum.

mod common;

use common::{refused, xtask};

#[test]
fn every_file_has_its_line() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let write = |name: &str, bytes: &[u8]| std::fs::write(folder.path().join(name), bytes).expect("written");
    write("a.urdf", b"<robot name=\"\xff\xfe\"/>");
    write("b.urdf", include_bytes!("../../nerd-lab/corpus/urdf/damping-blows-up-in-flight.urdf"));
    let run = xtask(&["urdf", folder.path().to_str().expect("utf-8")]);
    let said = String::from_utf8_lossy(&run.stdout);
    assert!(run.status.success(), "{}", String::from_utf8_lossy(&run.stderr));
    let line = |name: &str| said.lines().find(|l| l.contains(name)).unwrap_or_else(|| panic!("no line of {name}:\n{said}"));
    assert!(line("a.urdf").contains("is not UTF-8 text: byte 13") && line("a.urdf").contains("| the same"), "{said}");
    assert!(line("b.urdf").contains("| ok"), "{said}");
    assert!(said.contains("2 files: 1 move on a fixed base"), "{said}");
    refused(&["urdf", "/nowhere"], "/nowhere");
    write("c.urdf", include_bytes!("../../nerd-sim/assets/ant.urdf"));
    let here = folder.path().join("c.urdf");
    let here = here.to_str().expect("utf-8");
    refused(&["urdf", here, "--crowd", "4"], "--mujoco");
    refused(&["urdf", here, "--mujoco", "python3"], "--crowd");
    refused(&["urdf", here, "--crowd", "4", "--mujoco", "/no/python"], "/no/python");
}

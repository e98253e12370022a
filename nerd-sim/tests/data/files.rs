//! Outputs are whole, go where they are sent, and leave nothing behind.

use std::io::{Error, ErrorKind, Write};
use std::path::Path;

use nerd_sim::files::{claim, read_text, share, write, write_with};

fn names(folder: &Path) -> Vec<String> {
    let mut names: Vec<_> =
        std::fs::read_dir(folder).expect("folder").map(|e| e.expect("entry").file_name().into_string().expect("utf-8")).collect();
    names.sort();
    names
}

#[test]
fn what_killed_writers_left_is_removed_and_what_living_ones_write_is_not() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let path = folder.path().join("out.txt");
    // As a kill within a write leaves it.
    std::fs::write(folder.path().join(".nerd-dead.tmp"), b"half").expect("written");
    std::fs::write(folder.path().join(".other.tmp"), b"not ours").expect("written");
    write_with(&path, |file| {
        file.write_all(b"outer")?;
        assert_eq!(names(folder.path()).len(), 2, "the dead writer's file should be gone, ours and the other's be there");
        // Another writer comes and goes while this one is at work.
        write(&folder.path().join("inner.txt"), b"inner")
    })
    .expect("written");
    assert_eq!(names(folder.path()), [".other.tmp", "inner.txt", "out.txt"]);
    assert_eq!(std::fs::read(&path).expect("read"), b"outer");
}

#[test]
fn a_folder_is_claimed_once_and_an_empty_one_goes_again() {
    let above = tempfile::tempdir().expect("temporary folder");
    let folder = above.path().join("out");
    let first = claim(&folder).expect("free");
    let error = claim(&folder).expect_err("in use");
    assert!(error.kind() == ErrorKind::WouldBlock && error.to_string().contains("out is in use"), "{error}");
    drop(first);
    assert!(!folder.exists(), "an empty folder is left");
    let second = claim(&folder).expect("free again");
    write(&folder.join("result.txt"), b"result").expect("written");
    drop(second);
    assert_eq!(names(&folder), ["result.txt"]);
    // One that was there stays, empty or not.
    std::fs::create_dir(above.path().join("there")).expect("made");
    drop(claim(&above.path().join("there")).expect("free"));
    assert!(above.path().join("there").exists());
    // Some may have it together, but nobody else then.
    let both = [share(&folder).expect("free"), share(&folder).expect("shared")];
    assert!(claim(&folder).is_err(), "one of its own beside those who share");
    drop(both);
    let alone = claim(&folder).expect("free");
    assert!(share(&folder).is_err(), "shared with one of its own");
    drop(alone);
    // Folders above one, made with it, go with it.
    drop(claim(&above.path().join("a/b/c")).expect("free"));
    assert!(!above.path().join("a").exists(), "empty folders stay");
    // Of many at once one at a time has it.
    let (inside, most) = (std::sync::atomic::AtomicI32::new(0), std::sync::atomic::AtomicI32::new(0));
    std::thread::scope(|scope| {
        for _ in 0..8 {
            scope.spawn(|| {
                for _ in 0..200 {
                    if let Ok(_claim) = claim(&above.path().join("race")) {
                        most.fetch_max(1 + inside.fetch_add(1, std::sync::atomic::Ordering::SeqCst), std::sync::atomic::Ordering::SeqCst);
                        inside.fetch_sub(1, std::sync::atomic::Ordering::SeqCst);
                    }
                }
            });
        }
    });
    assert_eq!(most.into_inner(), 1, "claims at once");
}

#[test]
fn a_text_that_is_none_is_told_with_its_place() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let path = folder.path().join("text");
    std::fs::write(&path, b"one\ntwo \xff").expect("written");
    let error = read_text(&path).expect_err("no text");
    assert!(error.to_string().contains("byte 8, line 2"), "{error}");
    let full = |file: &mut dyn Write| file.write_all(b"ha").and(Err(Error::other("disk full")));
    assert!(write_with(&path, full).expect_err("full").to_string().contains("disk full"));
    assert_eq!(names(folder.path()), ["text"]);
}

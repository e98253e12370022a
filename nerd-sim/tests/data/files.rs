//! Outputs are whole, go where they are sent, and leave nothing behind.

use std::io::{Error, ErrorKind, Write};
use std::path::Path;

use nerd_sim::files::{claim, read_text, write, write_with};
use nerd_sim::prelude::System;

fn names(folder: &Path) -> Vec<String> {
    let mut names: Vec<_> = std::fs::read_dir(folder)
        .expect("folder")
        .map(|e| e.expect("entry").file_name().into_string().expect("utf-8"))
        .collect();
    names.sort();
    names
}

#[test]
fn what_killed_writers_left_is_removed_and_what_living_ones_write_is_not() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let path = folder.path().join("out.txt");
    // The file that a writer killed within a write leaves.
    std::fs::write(folder.path().join(".nerd-dead.tmp"), b"half").expect("written");
    std::fs::write(folder.path().join(".other.tmp"), b"not ours").expect("written");
    write_with(&path, |file| {
        file.write_all(b"outer")?;
        assert_eq!(
            names(folder.path()).len(),
            2,
            "the dead writer's file should be gone, ours and the other's be there"
        );
        // Another writer comes and goes while this one is at work.
        write(&folder.path().join("inner.txt"), b"inner")
    })
    .expect("written");
    assert_eq!(names(folder.path()), [".other.tmp", "inner.txt", "out.txt"]);
    assert_eq!(std::fs::read(&path).expect("read"), b"outer");
}

#[test]
fn many_writers_of_one_folder_do_not_disturb_each_other() {
    let folder = tempfile::tempdir().expect("temporary folder");
    std::thread::scope(|scope| {
        for writer in 0..8u8 {
            let path = folder.path().join(format!("{}.bin", writer % 4));
            scope.spawn(move || (0..50).for_each(|_| write(&path, &[writer; 5000]).expect("written")));
        }
    });
    assert_eq!(names(folder.path()), ["0.bin", "1.bin", "2.bin", "3.bin"]);
    for (k, name) in names(folder.path()).iter().enumerate() {
        let bytes = std::fs::read(folder.path().join(name)).expect("read");
        assert!(
            bytes.len() == 5000 && bytes.iter().all(|b| *b == bytes[0] && usize::from(*b) % 4 == k),
            "{name} is mixed"
        );
    }
}

#[cfg(unix)]
#[test]
fn symbolic_links_stay_and_lead_to_what_is_written() {
    use std::os::unix::fs::symlink;
    let folder = tempfile::tempdir().expect("temporary folder");
    let at = |name: &str| folder.path().join(name);
    std::fs::create_dir(at("far")).expect("made");
    symlink("far/there.txt", at("one")).expect("linked");
    symlink(at("one"), at("two")).expect("linked");
    for text in [b"first", b"again"] {
        write(&at("two"), text).expect("written");
        assert_eq!(std::fs::read(at("far/there.txt")).expect("read"), text);
    }
    assert!(["one", "two"].iter().all(|link| std::fs::symlink_metadata(at(link)).expect("there").is_symlink()));
    symlink("loop", at("loop")).expect("linked");
    assert!(write(&at("loop"), b"").is_err());
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
    // A folder that existed before stays, empty or not.
    std::fs::create_dir(above.path().join("there")).expect("made");
    drop(claim(&above.path().join("there")).expect("free"));
    assert!(above.path().join("there").exists());
    // Parent folders made by the claim are removed with it.
    drop(claim(&above.path().join("a/b/c")).expect("free"));
    assert!(!above.path().join("a").exists(), "empty folders stay");
    // Of many threads, one at a time holds the claim.
    let (inside, most) = (std::sync::atomic::AtomicI32::new(0), std::sync::atomic::AtomicI32::new(0));
    std::thread::scope(|scope| {
        for _ in 0..8 {
            scope.spawn(|| {
                for _ in 0..200 {
                    if let Ok(_claim) = claim(&above.path().join("race")) {
                        most.fetch_max(
                            1 + inside.fetch_add(1, std::sync::atomic::Ordering::SeqCst),
                            std::sync::atomic::Ordering::SeqCst,
                        );
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
    for (path, said) in [(folder.path(), "is a folder"), (Path::new("/dev/null"), "is a pipe or a device")] {
        let error = read_text(path).expect_err("no file");
        assert!(error.to_string().contains(said) || cfg!(windows), "{error}");
    }
    let error = claim(&path).expect_err("no folder").to_string();
    assert!(error.contains("is a file, not a folder"), "{error}");
    let full = |file: &mut dyn Write| file.write_all(b"ha").and(Err(Error::other("disk full")));
    assert!(write_with(&path, full).expect_err("full").to_string().contains("disk full"));
    assert_eq!(names(folder.path()), ["text"]);
}

/// Files beyond the bounds on a robot's text, a table and arrays; they are sparse on disk.
#[test]
fn files_beyond_their_bounds_are_refused_with_their_size() {
    let folder = tempfile::tempdir().expect("a folder");
    let large = |name: &str, bytes: u64| {
        let path = folder.path().join(name);
        std::fs::File::create(&path).and_then(|file| file.set_len(bytes)).expect("a sparse file");
        path
    };
    for name in ["a.urdf", "a.xml", "a.toml"] {
        let said = System::named(&large(name, 1 << 30).display().to_string()).expect_err("too large").to_string();
        assert!(said.contains("has 1024 MB; at most 64 MB are read") && said.contains(name), "{said}");
    }
    #[cfg(feature = "csv")]
    {
        let system = System::named("pendulum").expect("built in");
        let said = nerd_sim::rollout::States::read(&large("a.csv", 1 << 40), &system)
            .err()
            .map_or_else(String::new, |e| e.to_string());
        assert!(said.contains("has 1048576 MB; at most 2048 MB are read"), "{said}");
    }
    let said = nerd_sim::files::read(&large("a.safetensors", 1 << 42)).expect_err("too large").to_string();
    assert!(said.contains("has 4194304 MB; at most "), "{said}");
}

//! Runs a command line. Bad input ends with one line and exit code 2, and leaves no file behind.

use std::error::Error;
use std::ffi::OsString;
use std::path::Path;

use anyhow::Result;
use clap::{Command, CommandFactory, FromArgMatches, error::ErrorKind};
use nerd_train::provenance::Provenance;

use crate::{commands, out, refusals, renamed, signals};

/// A program: its verbs, and what they do.
pub trait Program: CommandFactory + FromArgMatches + Send {
    fn run(self) -> Result<()>;
}

/// The command line of a program, with grouped help.
pub fn program<P: Program>() -> Command {
    commands::prepare(P::command())
}

fn parse<P: Program>(words: Vec<OsString>) -> Result<P, clap::Error> {
    let mut program = program::<P>();
    // Calls the program in its help as it was typed: `nerd`, `python -m nerd`, else `cargo xtask`.
    if let Some(name) =
        words.first().and_then(|word| Path::new(word).file_stem()?.to_str()).filter(|name| name.ends_with("nerd"))
    {
        program = program.bin_name(name.to_string()).name(name.to_string());
    }
    // Refuses words that are not UTF-8: results, checkpoints and pages store file names as text.
    if let Some(word) = words.iter().skip(1).find(|word| word.to_str().is_none()) {
        let said = format!(
            "`{}` is not UTF-8; rename the file or folder, or make a link to it with such a name",
            word.display()
        );
        return Err(program.error(ErrorKind::InvalidUtf8, said));
    }
    let matches = program.try_get_matches_from_mut(words).map_err(|e| commands::explained(e, &mut program))?;
    if matches.get_flag("json") {
        out::json();
    }
    P::from_arg_matches(&matches).map_err(|e| e.format(&mut program))
}

/// Runs a verb on the thread pool; on this thread alone if no threads can be started.
fn spread(verb: impl Program) -> Result<()> {
    let pool = rayon::ThreadPoolBuilder::new;
    // An error without a source means that the pool already exists.
    let Some(e) = pool().build_global().err().filter(|e| e.source().is_some()) else { return verb.run() };
    tell!(
        "note: no threads can be started ({e}): all is done on one; allow more (ulimit -u), or ask for fewer (RAYON_NUM_THREADS)"
    );
    pool().num_threads(1).use_current_thread().build()?.install(|| verb.run())
}

/// Runs a command line (its first word is the program); returns the exit code.
pub fn call<P: Program>(words: impl IntoIterator<Item = OsString>) -> u8 {
    signals::heed();
    Provenance::begin();
    let (words, note) = renamed::replace(words.into_iter().collect());
    // Keeps errors to one line: the note on old names follows a success, or ends the error's line.
    let end = note.as_ref().map_or_else(String::new, |note| format!("; {note}"));
    let refuse = |error: String, code: u8| refusals::end(&(error + &end), code);
    match parse::<P>(words) {
        Ok(verb) => match spread(verb).and_then(|()| out::finish()) {
            Ok(()) => {
                note.iter().for_each(|note| tell!("note: {note}"));
                signals::ended()
            }
            Err(error) => {
                let code = refuse(refusals::failure(&error), 1);
                nerd_train::stop::asked().map_or(code, signals::code)
            }
        },
        // Prints help, on request or without a verb.
        Err(error) if !error.use_stderr() || error.kind() == ErrorKind::DisplayHelpOnMissingArgumentOrSubcommand => {
            error.exit()
        }
        Err(error) => refuse(refusals::usage(&error), 2),
    }
}

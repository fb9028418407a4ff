//! Where commands write: a folder that is found writable before the work starts, and standard output for results.
//!
//! Results go through `write`, not `println`: a reader that closes the pipe early then changes neither the work nor the exit code.

pub(crate) mod length;
mod lock;
mod stale;
mod text;

use std::ffi::OsString;
use std::fs::{self, File};
use std::io::{Error, ErrorKind, Write as _, stdout};
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use anyhow::{Context as _, Result, bail, ensure};
use imf_core::atomic_file::{
    AtomicFileError, keep_previous, remove_all_leftovers, remove_leftovers, write_atomically,
};
use serde::Serialize;
use serde_json::{Value, json};
use tempfile::{Builder, NamedTempFile};

pub use self::lock::{FolderLock, lock_folder};
pub(crate) use self::stale::SUMMARY;
use self::stale::{remove_stale, stale_files};
pub(crate) use self::text::{aligned, element_name, quoted, same_digits, shortened, show_measure};
pub use self::text::{short, table};
use crate::interrupt;
use crate::session::{Remarks, Session, remarks};

/// The program, as what it writes names it.
pub(crate) const PROGRAM: &str = concat!("imf ", env!("CARGO_PKG_VERSION"));

/// A folder for results. It is made only when there is a result to put into it.
#[derive(Debug)]
pub struct OutputFolder {
    pub(crate) path: PathBuf,
    /// From the first result until the folder is dropped.
    lock: OnceLock<FolderLock>,
}

impl OutputFolder {
    /// Finds out whether files can be made in the folder, or the folder itself, without leaving a trace.
    ///
    /// # Errors
    /// A path through a file, a place that may not be written, or earlier results in it that this run reads.
    pub fn check(path: &Path) -> Result<Self> {
        if let Some(read) = stale_files(path).iter().find(|file| times_named(file) > 0) {
            bail!(
                "{} is read, and would be replaced with the results in its folder: choose another --out",
                read.display()
            );
        }
        Self::of_one_file(path)
    }

    /// As [`OutputFolder::check`], where what else the folder holds stays.
    fn of_one_file(path: &Path) -> Result<Self> {
        let existing = path.ancestors().find(|ancestor| ancestor.as_os_str().is_empty() || exists(ancestor));
        let existing = match existing {
            Some(ancestor) if !ancestor.as_os_str().is_empty() => ancestor,
            _ => Path::new("."),
        };
        ensure!(
            existing.is_dir(),
            "cannot write to the folder {}: {} is a file",
            path.display(),
            existing.display()
        );
        // A name of its own: other threads and processes may be asking about the same folder.
        let probe = Builder::new()
            .prefix(".imf-")
            .suffix(".probe")
            .make_in(existing, |probe| File::create_new(probe));
        let refused = |source| AtomicFileError { path: path.to_owned(), source };
        probe.and_then(NamedTempFile::close).map_err(refused)?;
        Ok(Self { path: path.to_owned(), lock: OnceLock::new() })
    }

    pub(crate) fn create(&self) -> Result<()> {
        fs::create_dir_all(&self.path)
            .with_context(|| format!("cannot create the folder {}", self.path.display()))
    }

    /// Makes the folder, this run's own until it is dropped: the files of two runs would be mixed. What killed runs left unfinished
    /// there goes.
    pub(crate) fn create_locked(&self) -> Result<()> {
        let left =
            format!("the results in {} are not complete; run the same command again", self.path.display());
        interrupt::leave(left.into());
        self.create()?;
        let lock = lock_folder(&self.path)?;
        self.lock.get_or_init(|| lock);
        remove_all_leftovers(&self.path);
        Ok(())
    }

    /// As [`OutputFolder::create_locked`], and clears it of the results of an earlier run of this program.
    pub(crate) fn begin(&self, session: &Session) -> Result<()> {
        self.create_locked()?;
        let removed = remove_stale(&self.path)?;
        if removed > 0 {
            session
                .note(&format!("{removed} files of an earlier run in {} are replaced", self.path.display()));
        }
        Ok(())
    }

    /// Writes the summary, the last of a run's files.
    pub(crate) fn write_summary(&self, summary: &impl Serialize) -> Result<()> {
        write_json(&self.file(SUMMARY), summary).context(SUMMARY)?;
        self.complete();
        Ok(())
    }

    /// As [`OutputFolder::write_summary`], of a result that names there which files the run has left.
    pub(crate) fn write_summary_of(&self, result: &mut Value, files: &[&str]) -> Result<()> {
        result["program"] = json!(PROGRAM);
        result["files"] = json!(files);
        self.write_summary(result)
    }

    /// States for an interruption from here on that all of the run's files are written.
    pub(crate) fn complete(&self) {
        interrupt::leave(format!("the results in {} are complete", self.path.display()).into());
    }

    pub(crate) fn file(&self, name: &str) -> PathBuf {
        self.path.join(name)
    }
}

/// Refuses a source in the place where what is made of it is to be written.
pub(crate) fn require_other(source: &Path, replaced: &Path) -> Result<()> {
    ensure!(
        !is_same(source, replaced),
        "{} would be replaced by what is made of it: choose another --out",
        replaced.display()
    );
    Ok(())
}

/// Renames what an earlier run made before it is replaced: `field.safetensors` as
/// `field.former.safetensors`.
pub(crate) fn keep_former(session: &Session, path: &Path) -> Result<()> {
    if !path.exists() {
        return Ok(());
    }
    let ending = path.extension().unwrap_or_default().to_string_lossy();
    let former = path.with_extension(format!("former.{ending}"));
    let instead = if former.exists() { ", in place of what that held" } else { "" };
    keep_previous(path, &former).with_context(|| format!("cannot keep {}", path.display()))?;
    session.note(&format!("what {} held before is kept as {}{instead}", path.display(), former.display()));
    Ok(())
}

/// How many words of the command line name a file that exists: `--option FILE`, `--option=FILE`, `--option NUMBER=FILE`, `FILE@STEPS`,
/// `SET+FILE`, `FILE#NAME`; a name may hold any of these signs.
fn times_named(path: &Path) -> usize {
    let names = |word: &OsString| {
        if is_same(Path::new(word), path) {
            return true;
        }
        let word = word.to_string_lossy();
        let starts = || std::iter::once(0).chain(word.match_indices(['=', '+']).map(|(at, _)| at + 1));
        let ends = || word.match_indices(['@', '+', '#']).map(|(at, _)| at).chain([word.len()]);
        starts()
            .any(|from| ends().filter(|&to| from < to).any(|to| is_same(Path::new(&word[from..to]), path)))
    };
    std::env::args_os().skip(1).filter(names).count()
}

/// True where both name one file that exists.
fn is_same(one: &Path, other: &Path) -> bool {
    matches!((one.canonicalize(), other.canonicalize()), (Ok(one), Ok(other)) if one == other)
}

/// Also true for a link that leads nowhere, which cannot be made a folder.
fn exists(path: &Path) -> bool {
    fs::symlink_metadata(path).is_ok()
}

/// A single file for results. The folder around it is made only when there is a result to put into it.
#[derive(Debug)]
pub(crate) struct OutputFile {
    path: PathBuf,
    folder: OutputFolder,
}

impl OutputFile {
    /// Finds out whether the file can be written before the work for it starts, without leaving a trace.
    ///
    /// # Errors
    /// A folder in its place, or a place that may not be written.
    pub(crate) fn check(path: &Path) -> Result<Self> {
        if path.is_dir() {
            bail!("cannot write {}: it names a folder; give the name of a file", path.display());
        }
        if times_named(path) > 1 {
            bail!("{} is also read: choose another name for what is written", path.display());
        }
        let around = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let folder =
            OutputFolder::of_one_file(around).with_context(|| format!("cannot write {}", path.display()))?;
        Ok(Self { path: path.to_owned(), folder })
    }

    /// Makes the folder where it does not exist yet, removes what a killed run left of this file, and gives its path.
    pub(crate) fn begin(&self) -> Result<&Path> {
        self.folder.create()?;
        remove_leftovers(&self.path);
        Ok(&self.path)
    }
}

/// Writes text to standard output. A reader that has gone away is not an error: what the command found stays its exit code.
pub fn print(text: &str) -> Result<()> {
    let mut out = stdout().lock();
    let end: &[u8] = if text.ends_with('\n') { b"" } else { b"\n" };
    let written = out.write_all(text.as_bytes()).and_then(|()| out.write_all(end));
    written.and_then(|()| out.flush()).or_else(standard_output_failed)
}

/// What to say where standard output takes no more; nothing where its reader has gone away.
pub(crate) fn standard_output_failed(error: Error) -> Result<()> {
    let text = match error.kind() {
        ErrorKind::BrokenPipe => return Ok(()),
        ErrorKind::StorageFull | ErrorKind::QuotaExceeded => {
            format!(
                "cannot write to standard output: the disk is full ({error}); free some space or choose another disk"
            )
        }
        _ => format!("cannot write to standard output: {error}"),
    };
    Err(anyhow::Error::new(error).context(text))
}

/// Writes a line to standard error; a reader that has gone away is not an error.
pub(crate) fn eprint_line(line: std::fmt::Arguments<'_>) {
    let _ = writeln!(std::io::stderr().lock(), "{line}");
}

/// Prints a result to standard output: as JSON with --json, else as text.
pub(crate) fn print_result(session: &Session, json: &impl Serialize, words: &str) -> Result<()> {
    if session.json { print_json(json) } else { print(words) }
}

/// As [`print_result`], also where the result's files could not be written, which stays the error: what took long to find is not lost.
pub(crate) fn print_written(
    session: &Session,
    json: &impl Serialize,
    words: &str,
    written: Result<()>,
) -> Result<()> {
    let printed = print_result(session, json, words);
    written.and(printed)
}

#[derive(Serialize)]
struct JsonResult<'a, T> {
    #[serde(flatten)]
    value: &'a T,
    #[serde(flatten)]
    remarks: &'a Remarks,
}

/// A value as JSON; an object also has the session's remarks (`warnings`, `choices`).
fn json_text(value: &impl Serialize) -> Result<String> {
    let remarks = remarks();
    let is_object = !remarks.is_empty() && serde_json::to_value(value)?.is_object();
    Ok(if is_object {
        serde_json::to_string_pretty(&JsonResult { value, remarks: &remarks })?
    } else {
        serde_json::to_string_pretty(value)?
    })
}

/// Writes a value as JSON to standard output, with the session's remarks.
pub fn print_json(value: &impl Serialize) -> Result<()> {
    print(&json_text(value)?)
}

/// Writes a value as a JSON file, whole or not at all, with the session's remarks.
pub fn write_json(path: &Path, value: &impl Serialize) -> Result<()> {
    write_text(path, &(json_text(value)? + "\n"))
}

/// Writes a text file, whole or not at all.
pub fn write_text(path: &Path, text: &str) -> Result<()> {
    Ok(write_atomically(path, |file| file.write_all(text.as_bytes()))?)
}

/// Makes a folder that work will write to all along, after finding that it can.
pub fn prepare_folder(path: &Path) -> Result<()> {
    OutputFolder::check(path)?.create()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_below_a_file_is_refused_and_checking_leaves_no_trace() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("file.txt");
        fs::write(&file, "text").unwrap();
        for path in [file.clone(), file.join("sub"), file.join("sub/deeper")] {
            let message = format!("{:#}", OutputFolder::check(&path).unwrap_err());
            assert!(message.contains("file.txt is a file"), "{message}");
        }
        let deep = OutputFolder::check(&folder.path().join("a/b")).unwrap();
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1, "only file.txt");
        deep.create().unwrap();
        assert!(deep.path.is_dir());
        assert!(OutputFolder::check(Path::new("no-such-folder-here")).is_ok(), "below the current one");
    }

    #[test]
    #[cfg(target_os = "linux")]
    fn a_folder_that_may_not_be_written_is_named_with_the_remedy() {
        let message = crate::exit::message(&OutputFolder::check(Path::new("/sys/out")).unwrap_err());
        assert!(message.starts_with("cannot write /sys/out: ") && !message.contains("probe"), "{message}");
        assert!(message.ends_with("; choose another folder or change its permissions"), "{message}");
    }

    #[test]
    fn a_folder_is_checked_by_many_at_once() {
        let folder = tempfile::tempdir().unwrap();
        let check = || (0..200).all(|_| OutputFolder::check(folder.path()).is_ok());
        std::thread::scope(|scope| {
            let threads: Vec<_> = (0..4).map(|_| scope.spawn(check)).collect();
            assert!(threads.into_iter().all(|thread| thread.join().unwrap()));
        });
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0, "no trace");
    }

    #[test]
    fn a_file_gets_its_folder_when_it_is_written_and_not_before() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("new/answers.csv");
        let file = OutputFile::check(&path).unwrap();
        assert!(!path.parent().unwrap().exists());
        fs::create_dir(folder.path().join("new")).unwrap();
        let (left, other) =
            (folder.path().join("new/.answers.csv.x1.part"), folder.path().join("new/.b.csv.x1.part"));
        fs::write(&left, []).unwrap();
        fs::write(&other, []).unwrap();
        assert_eq!(file.begin().unwrap(), path);
        assert!(!left.exists() && other.exists());
        assert!(OutputFile::check(Path::new("answers.csv")).is_ok());
        let message = OutputFile::check(folder.path()).unwrap_err().to_string();
        assert!(message.contains("names a folder"), "{message}");
        fs::write(&path, []).unwrap();
        let message = format!("{:#}", OutputFile::check(&path.join("below.csv")).unwrap_err());
        assert!(message.contains("answers.csv is a file"), "{message}");
    }
}

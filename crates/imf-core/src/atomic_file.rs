//! Files that appear whole or not at all.
//!
//! A file is written under a temporary name in its own folder, flushed to the disk, and renamed. A reader of the final name sees
//! the old content or the new one, never half of either, also after a crash or a power cut.
//! On an error the temporary file is removed and the old content stays. A process that is killed cannot remove its
//! temporary file: [`remove_leftovers`] does so later. While a process writes one it holds a lock on it, so that other processes
//! leave it alone.

use std::ffi::{OsStr, OsString};
use std::fs::{self, File, TryLockError};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

use thiserror::Error;

/// How the names of temporary files end.
const PART: &str = ".part";
/// Bytes of a name that a temporary one repeats, which is longer than it and no longer than file systems allow.
const MOST_OF_NAME: usize = 200;

/// A file could not be written. Its old content, if there was any, is untouched.
#[derive(Debug, Error)]
#[error("cannot write {}: {source}{}", .path.display(), remedy(.source.kind()))]
pub struct AtomicFileError {
    /// The file to be written.
    pub path: PathBuf,
    /// What the system, or the function that made the content, said.
    pub source: io::Error,
}

fn remedy(kind: io::ErrorKind) -> &'static str {
    use io::ErrorKind::{PermissionDenied, QuotaExceeded, ReadOnlyFilesystem, StorageFull};
    match kind {
        PermissionDenied | ReadOnlyFilesystem => "; choose another folder or change its permissions",
        StorageFull | QuotaExceeded => ": the disk is full; free some space or choose another disk",
        _ => "",
    }
}

/// Writes a file whole or not at all: `write` receives a buffered writer, and its content replaces `path` only after
/// everything has reached the disk. A symbolic link is followed. On Unix a new file has the permissions that the
/// user's umask leaves, and a replaced file keeps its own.
///
/// # Errors
/// The folder is missing, may not be written or is full; an existing file is write-protected; `path` names a folder or a
/// device; or `write` failed. The temporary file is removed then.
pub fn write_atomically(
    path: impl AsRef<Path>,
    write: impl FnOnce(&mut BufWriter<&File>) -> io::Result<()>,
) -> Result<(), AtomicFileError> {
    replace(path.as_ref(), write).map_err(|source| AtomicFileError { path: path.as_ref().into(), source })
}

/// Gives what `path` holds now the further name `previous`, in the same folder, before it is replaced, without a moment in
/// which either is missing; where the file system has no second names, `path` is renamed.
///
/// # Errors
/// A folder that may not be written.
pub fn keep_previous(path: impl AsRef<Path>, previous: impl AsRef<Path>) -> io::Result<()> {
    let (path, previous) = (path.as_ref(), previous.as_ref());
    let folder = folder_of(path);
    let prefix = prefix(path.file_name().unwrap_or_default());
    let mut builder = tempfile::Builder::new();
    match builder.prefix(&prefix).suffix(PART).make_in(folder, |link| fs::hard_link(path, link)) {
        Ok(link) => link.into_temp_path().persist(previous).map_err(|error| error.error)?,
        Err(_) => fs::rename(path, previous)?,
    }
    sync_folder(folder)
}

/// Removes the temporary files that killed processes left while they wrote `path`, and none that is being written.
/// Returns how many there were; what cannot be removed stays.
pub fn remove_leftovers(path: impl AsRef<Path>) -> usize {
    let target = fs::canonicalize(&path).unwrap_or_else(|_| path.as_ref().to_path_buf());
    remove_temporary(folder_of(&target), |name| {
        target.file_name().is_some_and(|own| prefix(own).to_str() == Some(&format!(".{name}.")))
    })
}

/// As [`remove_leftovers`], of whatever was being written in a folder.
pub fn remove_all_leftovers(folder: impl AsRef<Path>) -> usize {
    remove_temporary(folder.as_ref(), |_| true)
}

/// Removes the temporary files of a folder whose final names are `wanted`, but for those that somebody is writing.
fn remove_temporary(folder: &Path, wanted: impl Fn(&str) -> bool) -> usize {
    let is_leftover = |entry: &fs::DirEntry| {
        let file = entry.file_name();
        let inner = file.to_str().and_then(|file| file.strip_prefix('.')?.strip_suffix(PART));
        let name = inner.and_then(|inner| inner.rsplit_once('.'));
        name.is_some_and(|(name, random)| !name.is_empty() && !random.is_empty() && wanted(name))
            && entry.file_type().is_ok_and(|kind| kind.is_file())
    };
    let removed = |entry: &fs::DirEntry| {
        let file = File::options().read(true).write(true).open(entry.path());
        let written = file.is_ok_and(|file| matches!(file.try_lock(), Err(TryLockError::WouldBlock)));
        !written && fs::remove_file(entry.path()).is_ok()
    };
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    entries.filter(is_leftover).filter(removed).count()
}

/// How the names of the temporary files of a name begin.
fn prefix(name: &OsStr) -> OsString {
    let mut prefix = OsString::from(".");
    match name.to_str() {
        Some(name) => prefix.push(&name[..name.floor_char_boundary(MOST_OF_NAME)]),
        None => prefix.push(name),
    }
    prefix.push(".");
    prefix
}

/// The folder that a file is in.
fn folder_of(path: &Path) -> &Path {
    path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

fn replace(path: &Path, write: impl FnOnce(&mut BufWriter<&File>) -> io::Result<()>) -> io::Result<()> {
    let refuse = |kind: io::ErrorKind, what: &str| Err(io::Error::new(kind, what.to_owned()));
    // Renaming onto a link would replace the link, not the file behind it.
    let target = fs::canonicalize(path).unwrap_or_else(|_| path.to_path_buf());
    let existing = fs::metadata(&target).ok();
    // Renaming onto a device would remove the device.
    let is_file = existing.as_ref().is_none_or(fs::Metadata::is_file);
    let Some(name) = target.file_name().filter(|_| is_file) else {
        return refuse(io::ErrorKind::IsADirectory, "it names a folder or a device; give the name of a file");
    };
    // Renaming needs no permission on the old file, so its protection has to be respected here.
    if existing.as_ref().is_some_and(|metadata| metadata.permissions().readonly()) {
        return refuse(io::ErrorKind::PermissionDenied, "the file is write-protected");
    }
    let folder = folder_of(&target);
    if !folder.is_dir() {
        let what = format!("its folder {} does not exist; create it first", folder.display());
        return refuse(io::ErrorKind::NotFound, &what);
    }

    let prefix = prefix(name);
    let mut builder = tempfile::Builder::new();
    // Not as the crate would: its file is for the user's eyes only, and its errors quote the temporary name.
    let temporary =
        builder.prefix(&prefix).suffix(PART).make_in(folder, |temporary| File::create_new(temporary))?;
    // Where files cannot be locked, nobody else may write in the folder.
    let _ = temporary.as_file().try_lock();
    let mut writer = BufWriter::with_capacity(1 << 16, temporary.as_file());
    write(&mut writer).and_then(|()| writer.flush())?;
    drop(writer);
    if let Some(metadata) = existing {
        temporary.as_file().set_permissions(metadata.permissions())?;
    }
    temporary.as_file().sync_all()?;
    temporary.persist(&target).map_err(|error| error.error)?;
    sync_folder(folder)
}

/// Makes the rename itself durable. Other systems than Unix offer no such call.
#[cfg(unix)]
fn sync_folder(folder: &Path) -> io::Result<()> {
    use io::ErrorKind::{InvalidInput, PermissionDenied, Unsupported};
    match File::open(folder).and_then(|folder| folder.sync_all()) {
        // Some network file systems cannot flush a folder, and some folders may be written but not listed.
        Err(error) if matches!(error.kind(), InvalidInput | Unsupported | PermissionDenied) => Ok(()),
        result => result,
    }
}

#[cfg(not(unix))]
fn sync_folder(_: &Path) -> io::Result<()> {
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn entries(folder: &Path) -> Vec<OsString> {
        fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().file_name()).collect()
    }

    #[test]
    fn a_file_is_made_and_replaced_whole() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.bin");
        write_atomically(&path, |writer| writer.write_all(b"old")).unwrap();
        write_atomically(&path, |writer| {
            writer.write_all(b"new content")?;
            writer.flush()?;
            // Until the end, readers see what was there before.
            assert_eq!(fs::read(&path)?, b"old");
            Ok(())
        })
        .unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"new content");
        assert_eq!(entries(folder.path()), ["a.bin"]);
    }

    #[test]
    fn a_failure_keeps_the_old_file_and_leaves_nothing_behind() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.bin");
        fs::write(&path, b"old").unwrap();
        let full = |writer: &mut BufWriter<&File>| {
            writer.write_all(b"half")?;
            Err(io::Error::from(io::ErrorKind::StorageFull))
        };
        let error = write_atomically(&path, full).unwrap_err();
        assert_eq!(error.source.kind(), io::ErrorKind::StorageFull);
        assert!(
            error.to_string().contains("a.bin") && error.to_string().contains("free some space"),
            "{error}"
        );
        assert_eq!(fs::read(&path).unwrap(), b"old");
        assert_eq!(entries(folder.path()), ["a.bin"]);
    }

    #[test]
    fn leftovers_of_the_killed_go_and_nothing_else() {
        let folder = tempfile::tempdir().unwrap();
        for name in ["a.bin", ".a.bin.x1.part", ".a.bin.x2.part", ".b.bin.x1.part", "a.bin.part"] {
            fs::write(folder.path().join(name), b"").unwrap();
        }
        assert_eq!(remove_leftovers(folder.path().join("a.bin")), 2);
        let mut left = entries(folder.path());
        left.sort();
        assert_eq!(left, [".b.bin.x1.part", "a.bin", "a.bin.part"]);
        for name in [".part", ".mine.part", "..x1.part"] {
            fs::write(folder.path().join(name), b"").unwrap();
        }
        fs::create_dir(folder.path().join(".c.bin.x1.part")).unwrap();
        assert_eq!(remove_all_leftovers(folder.path()), 1, "that of b.bin");
        assert_eq!(entries(folder.path()).len(), 6);
        assert_eq!(remove_all_leftovers(folder.path().join("a.bin")), 0);
    }

    #[test]
    fn names_may_be_as_long_as_the_file_system_allows() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("ö".repeat(127));
        write_atomically(&path, |file| file.write_all(b"new")).unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"new");
        let leftover = folder.path().join(format!(".{}.abcdef{PART}", "ö".repeat(100)));
        fs::write(&leftover, b"").unwrap();
        assert_eq!((remove_leftovers(&path), leftover.exists()), (1, false));
    }

    #[test]
    fn what_is_being_written_is_no_leftover() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.bin");
        write_atomically(&path, |out| {
            assert_eq!(remove_leftovers(&path) + remove_all_leftovers(folder.path()), 0);
            out.write_all(b"whole")
        })
        .unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"whole");
    }

    #[test]
    fn a_file_is_kept_under_another_name_before_it_is_replaced() {
        let folder = tempfile::tempdir().unwrap();
        let [path, previous] = ["a.bin", "a.former.bin"].map(|name| folder.path().join(name));
        for content in ["one", "two"] {
            fs::write(&path, content).unwrap();
            keep_previous(&path, &previous).unwrap();
            write_atomically(&path, |out| out.write_all(b"new")).unwrap();
            assert_eq!(fs::read_to_string(&previous).unwrap(), content);
            assert_eq!(fs::read_to_string(&path).unwrap(), "new");
        }
        assert_eq!(entries(folder.path()).len(), 2);
        assert!(keep_previous(folder.path().join("none"), &previous).is_err());
    }

    #[test]
    fn impossible_places_are_named() {
        let folder = tempfile::tempdir().unwrap();
        let missing = write_atomically(folder.path().join("no/such/a.bin"), |_| Ok(())).unwrap_err();
        assert_eq!(missing.source.kind(), io::ErrorKind::NotFound, "{missing}");
        let error = write_atomically(folder.path(), |_| Ok(())).unwrap_err();
        assert_eq!(error.source.kind(), io::ErrorKind::IsADirectory, "{error}");
        let path = folder.path().join("protected");
        fs::write(&path, b"old").unwrap();
        let mut permissions = fs::metadata(&path).unwrap().permissions();
        permissions.set_readonly(true);
        fs::set_permissions(&path, permissions).unwrap();
        let error = write_atomically(&path, |_| Ok(())).unwrap_err();
        assert_eq!(error.source.kind(), io::ErrorKind::PermissionDenied, "{error}");
        assert_eq!(fs::read(&path).unwrap(), b"old");
        #[cfg(target_os = "linux")]
        {
            let error = write_atomically("/sys/a.bin", |_| Ok(())).unwrap_err().to_string();
            assert!(error.contains("choose another folder") && !error.contains(PART), "{error}");
        }
    }

    #[cfg(unix)]
    #[test]
    fn links_devices_and_permissions_are_respected() {
        use std::os::unix::fs::{PermissionsExt, symlink};
        let folder = tempfile::tempdir().unwrap();
        let (path, link) = (folder.path().join("real"), folder.path().join("link"));
        fs::write(&path, b"old").unwrap();
        fs::set_permissions(&path, fs::Permissions::from_mode(0o640)).unwrap();
        symlink(&path, &link).unwrap();
        write_atomically(&link, |writer| writer.write_all(b"new")).unwrap();
        assert!(fs::symlink_metadata(&link).unwrap().is_symlink());
        assert_eq!(fs::read(&path).unwrap(), b"new");
        assert_eq!(fs::metadata(&path).unwrap().permissions().mode() & 0o777, 0o640);
        let error = write_atomically("/dev/null", |_| Ok(())).unwrap_err();
        assert_eq!(error.source.kind(), io::ErrorKind::IsADirectory, "{error}");
    }
}

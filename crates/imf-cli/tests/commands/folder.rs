//! A fresh folder to run the binary in.

use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

use ndarray::Array3;
use ndarray_npy::{ReadNpyExt, ReadableElement};
use serde_json::Value;
use tempfile::TempDir;

/// A triangle short of a cube of edge 100: an open mesh.
pub(crate) const OPEN_CUBE: &str = "v 0 0 0\nv 100 0 0\nv 0 100 0\nv 100 100 0\nv 0 0 100\nv 100 0 100\nv 0 100 100\n\
                                    v 100 100 100\nf 1 3 4\nf 1 4 2\nf 5 6 8\nf 5 8 7\nf 1 2 6\nf 1 6 5\nf 3 7 8\n\
                                    f 3 8 4\nf 1 5 7\nf 1 7 3\nf 2 4 8\n";
/// The last triangle.
pub(crate) const LAST_FACE: &str = "f 2 8 6\n";

pub(crate) struct Folder(TempDir);

/// What a run left behind.
pub(crate) struct Run {
    pub(crate) code: Option<i32>,
    pub(crate) stdout: String,
    pub(crate) stderr: String,
}

impl Folder {
    pub(crate) fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    pub(crate) fn write(&self, name: &str, content: impl AsRef<[u8]>) {
        let path = self.path(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, content).unwrap();
    }

    pub(crate) fn read(&self, name: &str) -> String {
        std::fs::read_to_string(self.path(name)).unwrap()
    }

    pub(crate) fn npy<T: ReadableElement>(&self, name: &str) -> Array3<T> {
        Array3::read_npy(std::fs::File::open(self.path(name)).unwrap()).unwrap()
    }

    /// Every file and folder below this one.
    pub(crate) fn entries(&self) -> Vec<PathBuf> {
        let (mut found, mut waiting) = (vec![], vec![self.0.path().to_owned()]);
        while let Some(folder) = waiting.pop() {
            for entry in std::fs::read_dir(folder).unwrap() {
                let path = entry.unwrap().path();
                if path.is_dir() {
                    waiting.push(path.clone());
                }
                found.push(path.strip_prefix(self.0.path()).map(Path::to_owned).unwrap());
            }
        }
        found.sort();
        found
    }

    /// The binary in this folder, on a machine without a Vulkan driver.
    pub(crate) fn command(&self, arguments: &[&str]) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_imf"));
        command
            .args(arguments)
            .current_dir(self.0.path())
            .env("VK_DRIVER_FILES", "/nonexistent")
            .env("VK_ICD_FILENAMES", "/nonexistent")
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped());
        command
    }

    pub(crate) fn run(&self, arguments: &[&str]) -> Run {
        Run::of(self.command(arguments).spawn().unwrap())
    }

    pub(crate) fn run_with_input(&self, arguments: &[&str], input: &str) -> Run {
        let mut child = self.command(arguments).stdin(Stdio::piped()).spawn().unwrap();
        child.stdin.take().unwrap().write_all(input.as_bytes()).unwrap();
        Run::of(child)
    }

    /// Runs what must succeed.
    pub(crate) fn succeed(&self, arguments: &[&str]) -> Run {
        let run = self.run(arguments);
        assert_eq!(run.code, Some(0), "{arguments:?}: {}", run.stderr);
        run
    }

    /// Runs what must succeed and answer in JSON.
    pub(crate) fn json(&self, arguments: &[&str]) -> Value {
        let run = self.succeed(&[arguments, &["--json"]].concat());
        serde_json::from_str(&run.stdout).unwrap_or_else(|error| panic!("{error}: {}", run.stdout))
    }

    /// Runs what must be refused: exit code 1, one message that holds all of `expected`, and nothing left behind.
    pub(crate) fn refuse(&self, arguments: &[&str], expected: &[&str]) {
        let before = self.entries();
        let run = self.run(arguments);
        run.is_refusal(expected, arguments);
        assert_eq!(self.entries(), before, "{arguments:?} left something behind");
    }
}

impl Run {
    pub(crate) fn of(child: Child) -> Self {
        let output = child.wait_with_output().unwrap();
        Self {
            code: output.status.code(),
            stdout: String::from_utf8(output.stdout).unwrap(),
            stderr: String::from_utf8(output.stderr).unwrap(),
        }
    }

    pub(crate) fn is_refusal(&self, expected: &[&str], what: &[&str]) {
        self.is_refusal_with(1, expected, what);
    }

    /// A refusal of what was given, as of a wrong argument.
    pub(crate) fn is_bad_input(&self, expected: &[&str]) {
        self.is_refusal_with(2, expected, &[]);
    }

    fn is_refusal_with(&self, wanted: i32, expected: &[&str], what: &[&str]) {
        let Self { code, stdout, stderr } = self;
        assert_eq!(*code, Some(wanted), "{what:?}: {stderr}");
        assert!(stdout.is_empty(), "{what:?}: {stdout}");
        let messages: Vec<&str> = stderr.lines().filter(|line| line.starts_with("imf: error:")).collect();
        assert_eq!(messages.len(), 1, "{what:?}: {stderr}");
        assert_eq!(stderr.lines().last(), messages.last().copied(), "{what:?}: the message comes last");
        assert!(!stderr.contains("panicked"), "{what:?}: {stderr}");
        for text in expected {
            assert!(messages[0].contains(text), "{what:?} should say '{text}': {stderr}");
        }
    }
}

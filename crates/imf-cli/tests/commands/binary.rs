//! Running the command in a folder of its own.

use std::io::{BufRead as _, BufReader, Read as _, Write as _};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use imf_fields::model::Model;
#[cfg(unix)]
use imf_gpu::{adapters, wgpu::DeviceType};
use serde_json::Value;

/// The bracket at a seventh of its grid: 1,764 voxels, sections in a millisecond.
pub(crate) const DATASET: &str =
    "dataset bracket --dims 7,21,12 --allow-coarse --orientations fibonacci:16 --out data";
/// A network that a step takes well under a millisecond.
pub(crate) const TRAIN: &str =
    "train siren5 data --device cpu --network 3x24:10 --rate 1e-3 --batch 256 --no-calibrate";

/// Settings of `imf calibrate` that take little time.
pub(crate) const FEW_POSES: &str = "--poses 4096 --boundary 1024 --false-free 0.1";

/// A fresh folder; it goes when the value does.
pub(crate) struct Workdir {
    folder: tempfile::TempDir,
    /// Whether runs see the machine's Vulkan drivers.
    adapters: bool,
}

/// How a run of the command ended.
pub(crate) struct Finished {
    line: String,
    pub(crate) code: Option<i32>,
    pub(crate) stdout: String,
    pub(crate) stderr: String,
}

impl Workdir {
    /// A folder to run the command in as on a machine without a Vulkan driver.
    pub(crate) fn new() -> Self {
        Self { folder: tempfile::tempdir().unwrap(), adapters: false }
    }

    /// A folder to run the command in with the machine's own adapters.
    pub(crate) fn with_adapters() -> Self {
        Self { adapters: true, ..Self::new() }
    }

    /// A folder that holds the small dataset.
    pub(crate) fn with_dataset() -> Self {
        let work = Self::new();
        work.imf(DATASET).done();
        work
    }

    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// Names of what lies in a folder, sorted.
    pub(crate) fn names(&self, folder: &str) -> Vec<String> {
        let entries = std::fs::read_dir(self.path(folder)).unwrap();
        let mut names: Vec<_> =
            entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
        names.sort_unstable();
        names
    }

    /// Every file and folder below this one.
    pub(crate) fn entries(&self) -> Vec<PathBuf> {
        let (mut found, mut waiting) = (vec![], vec![self.path("")]);
        while let Some(folder) = waiting.pop() {
            for entry in std::fs::read_dir(folder).unwrap() {
                let path = entry.unwrap().path();
                if path.is_dir() {
                    waiting.push(path.clone());
                }
                found.push(path.strip_prefix(self.folder.path()).map(Path::to_owned).unwrap());
            }
        }
        found.sort();
        found
    }

    pub(crate) fn bytes(&self, name: &str) -> Vec<u8> {
        std::fs::read(self.path(name)).unwrap_or_else(|error| panic!("{name}: {error}"))
    }

    pub(crate) fn text(&self, name: &str) -> String {
        String::from_utf8(self.bytes(name)).unwrap()
    }

    pub(crate) fn write(&self, name: &str, content: impl AsRef<[u8]>) {
        let path = self.path(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, content).unwrap();
    }

    pub(crate) fn model(&self, name: &str) -> Model {
        Model::read(&self.path(name)).unwrap()
    }

    /// A JSON file that the command wrote.
    pub(crate) fn read_json(&self, name: &str) -> Value {
        serde_json::from_str(&self.text(name)).unwrap()
    }

    /// Fails unless the file is a PNG picture.
    pub(crate) fn picture(&self, name: &str) {
        assert!(self.bytes(name).starts_with(b"\x89PNG\r\n\x1a\n"), "{name} is not a PNG");
    }

    /// The command with a line of arguments, split at spaces.
    pub(crate) fn command(&self, line: &str) -> Command {
        let mut command = Command::new(crate::PROGRAM);
        command.args(line.split_whitespace()).current_dir(self.folder.path()).stdin(Stdio::null());
        if !self.adapters {
            command.env("VK_DRIVER_FILES", "/nonexistent").env("VK_ICD_FILENAMES", "/nonexistent");
        }
        command
    }

    pub(crate) fn imf(&self, line: &str) -> Finished {
        finish(line, &mut self.command(line))
    }

    /// Runs the command with that text at its standard input.
    pub(crate) fn imf_with_input(&self, line: &str, input: &str) -> Finished {
        let mut command = self.command(line);
        command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
        let mut child = command.spawn().unwrap();
        child.stdin.take().unwrap().write_all(input.as_bytes()).unwrap();
        Finished::new(line, &child.wait_with_output().unwrap())
    }

    /// Runs the command where no file may be longer than so many blocks of 512 bytes, as where a disk is full.
    #[cfg(target_os = "linux")]
    pub(crate) fn imf_in_blocks(&self, blocks: u32, line: &str) -> Finished {
        let mut shell = Command::new("sh");
        shell.args(["-c", &format!("ulimit -f {blocks}; exec \"$@\""), "sh", crate::PROGRAM]);
        finish(line, shell.args(line.split_whitespace()).current_dir(self.path("")).stdin(Stdio::null()))
    }

    /// Runs the command where the reader of its results has gone away.
    #[cfg(unix)]
    pub(crate) fn imf_unread(&self, line: &str) -> Finished {
        let (_, results) = std::io::pipe().unwrap();
        finish(line, self.command(line).stdout(results))
    }

    /// Runs what must succeed and answer in JSON.
    pub(crate) fn json(&self, line: &str) -> Value {
        self.imf(&format!("{line} --json")).done().json()
    }

    /// Measures error rates of a field's decisions at few poses: `imf eval`, which needs some, measures at many where it has none.
    pub(crate) fn calibrate_quickly(&self, field: &str) {
        self.imf(&format!("calibrate {field} {FEW_POSES}")).done();
    }

    /// Runs what must be refused with all these words in the last line, and leave nothing behind.
    pub(crate) fn refuse(&self, line: &str, words: &[&str]) {
        let before = self.entries();
        self.imf(line).refused(words).with_it_last();
        assert_eq!(self.entries(), before, "`imf {line}` left something behind");
    }

    /// The same with exit code 2, as of wrong input.
    pub(crate) fn refuse_input(&self, line: &str, words: &[&str]) {
        let before = self.entries();
        self.imf(line).bad_input(words);
        assert_eq!(self.entries(), before, "`imf {line}` left something behind");
    }

    /// Starts the command and presses Ctrl-C as soon as a file is there.
    #[cfg(unix)]
    pub(crate) fn interrupted_once_there_is(&self, file: &str, line: &str) -> Finished {
        let mut child = self.command(line).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
        self.wait_for(file, &mut child);
        signal("INT", &child.id().to_string());
        let output = child.wait_with_output().unwrap();
        assert!(self.path(file).exists(), "`imf {line}` never wrote {file}");
        Finished::new(line, &output)
    }

    /// Waits for a file as long as the process runs, up to a minute.
    #[cfg(unix)]
    pub(crate) fn wait_for(&self, file: &str, child: &mut std::process::Child) {
        let begun = Instant::now();
        let waits = || !self.path(file).exists() && begun.elapsed() < Duration::from_secs(60);
        while waits() && child.try_wait().unwrap().is_none() {
            std::thread::sleep(Duration::from_millis(1));
        }
    }

    /// Runs the command, which trains, interrupted as by Ctrl-C after so many of its reports, where it is not done by then.
    #[cfg(unix)]
    pub(crate) fn interrupted_after(&self, reports: u64, line: &str) -> Finished {
        let mut command = self.command(line);
        finish(line, command.env("IMF_INTERRUPT_AFTER_REPORTS", reports.to_string()))
    }

    /// Starts the command and presses Ctrl-C as soon as its messages have these words.
    #[cfg(unix)]
    pub(crate) fn interrupted_once_it_says(&self, words: &str, line: &str) -> Finished {
        signalled_once_it_says(words, line, &mut self.command(line), "INT")
    }
}

/// Runs a prepared command and sends it a signal once it has said some words.
#[cfg(unix)]
pub(crate) fn signalled_once_it_says(words: &str, line: &str, command: &mut Command, name: &str) -> Finished {
    let mut child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    let mut messages = BufReader::new(child.stderr.take().unwrap());
    let mut said = String::new();
    while !said.contains(words) && messages.read_line(&mut said).unwrap() > 0 {}
    assert!(said.contains(words), "`imf {line}` never said '{words}':\n{said}");
    signal(name, &child.id().to_string());
    messages.read_to_string(&mut said).unwrap();
    let mut output = child.wait_with_output().unwrap();
    output.stderr = said.into_bytes();
    Finished::new(line, &output)
}

#[cfg(unix)]
pub(crate) fn signal(name: &str, process: &str) {
    // The shell's own kill: a program of that name is not everywhere.
    let kill = format!("kill -{name} {process}");
    Command::new("sh").args(["-c", &kill]).stderr(Stdio::null()).status().unwrap();
}

/// Runs a prepared command to its end.
pub(crate) fn finish(line: &str, command: &mut Command) -> Finished {
    Finished::new(line, &command.output().unwrap())
}

impl Finished {
    pub(crate) fn new(line: &str, output: &std::process::Output) -> Self {
        let text = |bytes: &[u8]| String::from_utf8(bytes.to_vec()).unwrap();
        let (stdout, stderr) = (text(&output.stdout), text(&output.stderr));
        assert!(!stderr.contains("panicked"), "`imf {line}` panicked:\n{stderr}");
        Self { line: line.to_owned(), code: output.status.code(), stdout, stderr }
    }

    fn errors(&self) -> Vec<&str> {
        self.stderr.lines().filter(|line| line.starts_with("imf: error:")).collect()
    }

    /// It succeeded.
    pub(crate) fn done(self) -> Self {
        assert!(self.errors().is_empty(), "{}", self.stderr);
        self.exits(0)
    }

    /// It ended with this exit code.
    pub(crate) fn exits(self, code: i32) -> Self {
        assert_eq!(self.code, Some(code), "`imf {}`:\n{}{}", self.line, self.stdout, self.stderr);
        self
    }

    /// All these words are in its result.
    pub(crate) fn says(&self, words: &[&str]) {
        self.has(words, &self.stdout);
    }

    /// All these words are in its messages.
    pub(crate) fn warns(&self, words: &[&str]) {
        self.has(words, &self.stderr);
    }

    fn has(&self, words: &[&str], text: &str) {
        for word in words {
            assert!(text.contains(word), "`imf {}`: no '{word}' in\n{text}", self.line);
        }
    }

    /// It failed with one message that has all these words, and printed no result.
    pub(crate) fn refused(self, words: &[&str]) -> Self {
        self.failed(1, words)
    }

    /// The same of what was given, as of a wrong argument or a file that says something wrong.
    pub(crate) fn bad_input(self, words: &[&str]) -> Self {
        self.failed(2, words).with_it_last()
    }

    /// Nothing was said behind the error.
    fn with_it_last(self) -> Self {
        assert_eq!(
            self.stderr.lines().last(),
            Some(self.errors()[0]),
            "`imf {}`: what comes last",
            self.line
        );
        self
    }

    fn failed(self, code: i32, words: &[&str]) -> Self {
        assert_eq!(self.code, Some(code), "`imf {}`:\n{}", self.line, self.stderr);
        let errors = self.errors();
        assert_eq!(errors.len(), 1, "`imf {}`: one error line in\n{}", self.line, self.stderr);
        for word in words {
            assert!(errors[0].contains(word), "`imf {}`: no '{word}' in\n{}", self.line, self.stderr);
        }
        assert_eq!(self.stdout, "", "`imf {}`", self.line);
        self
    }

    /// It stopped at Ctrl-C and said so with these words.
    pub(crate) fn interrupted(self, words: &[&str]) -> Self {
        assert_eq!(self.code, Some(130), "`imf {}`:\n{}", self.line, self.stderr);
        assert!(self.errors().is_empty(), "{}", self.stderr);
        let said = self.stderr.lines().find(|line| line.starts_with("imf: interrupted:"));
        let said = said.unwrap_or_else(|| panic!("nothing said:\n{}", self.stderr));
        assert!(words.iter().all(|word| said.contains(word)), "{words:?} in {said}");
        self
    }

    /// Standard output as JSON.
    pub(crate) fn json(&self) -> Value {
        serde_json::from_str(&self.stdout)
            .unwrap_or_else(|error| panic!("`imf {}`: {error} in\n{}{}", self.line, self.stdout, self.stderr))
    }
}

/// Software Vulkan where there is some, else the GPU: the tests ask for any adapter, not for a certain one.
#[cfg(unix)]
pub(crate) fn device() -> &'static str {
    let found = adapters();
    assert!(
        !found.is_empty(),
        "there is no adapter.\nTo leave these tests out on purpose: IMF_NO_GPU_TESTS=1 cargo test"
    );
    if found.iter().any(|adapter| adapter.kind == DeviceType::Cpu) { "software" } else { "gpu" }
}

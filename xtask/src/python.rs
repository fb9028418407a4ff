//! The Python package: its tests, in a virtual environment of their own below `target`.
//!
//! `cargo xtask test` takes the native module as the workspace builds it, so that nothing is compiled twice, and puts it beside the
//! package's sources in the environment. `cargo xtask wheel` builds the wheel as users get it and tests that.

use std::env;
use std::ffi::OsStr;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, Result, bail, ensure};

use crate::checks::{cargo, run_shown};
use crate::debian::Need;
use crate::{root, target};

/// Names another interpreter.
const INTERPRETER: &str = "IMF_PYTHON";
/// Fails where the interpreter is too old, or cannot make environments.
const PROBE: &str = "import sys, venv, ensurepip; sys.exit(sys.version_info < (3, 10))";

const PYTHON: Need = Need {
    sentence: "tests of the Python package need Python 3.10 or later with venv on the PATH, or IMF_PYTHON to name one",
    packages: &["python3", "python3-venv"],
    opt_out: "IMF_NO_PYTHON_TESTS",
};

fn package() -> PathBuf {
    root().join("crates/imf-python")
}

/// Tests the package as the workspace builds it.
///
/// # Errors
/// No Python that serves and none that could be installed; a build or a test that fails.
pub(crate) fn test() -> Result<()> {
    if PYTHON.is_left_out() {
        return Ok(());
    }
    let environment = Environment::new("python", &interpreter()?)?;
    // With the tests' features, as everything else was built.
    cargo(&["build", "--workspace", "--lib", "--tests"], &[])?;
    environment.install_package(&target().join("debug").join(library()))?;
    environment.test()
}

/// Builds the wheel as users get it, installs it into an environment of its own, and tests it there.
///
/// # Errors
/// As [`test()`]; `maturin` that cannot be had.
pub(crate) fn wheel() -> Result<()> {
    let environment = Environment::new("python-wheel", &interpreter()?)?;
    environment.pip(&["maturin>=1.9,<2"])?;
    let folder = target().join("wheels");
    if folder.exists() {
        fs::remove_dir_all(&folder).with_context(|| folder.display().to_string())?;
    }
    let manifest = package().join("Cargo.toml");
    let build = [
        OsStr::new("-m"),
        "maturin".as_ref(),
        "build".as_ref(),
        "--release".as_ref(),
        "--manifest-path".as_ref(),
        manifest.as_os_str(),
        "--out".as_ref(),
        folder.as_os_str(),
    ];
    environment.python(&build)?;
    let wheels: Vec<PathBuf> = fs::read_dir(&folder)?.filter_map(|entry| Some(entry.ok()?.path())).collect();
    let [wheel] = wheels.as_slice() else { bail!("{} wheels were built, not one", wheels.len()) };
    let name = wheel.file_name().unwrap_or_default().to_string_lossy().into_owned();
    ensure!(name.contains("-cp310-abi3-"), "{name} is not a wheel for every Python from 3.10 on");
    environment.pip(&["--force-reinstall", "--no-deps", &wheel.to_string_lossy()])?;
    environment.test()?;
    println!("{}: {:.1} MB", wheel.display(), fs::metadata(wheel)?.len() as f64 / 1e6);
    Ok(())
}

/// File name of the native module as Cargo builds it.
fn library() -> &'static str {
    match env::consts::OS {
        "windows" => "_imf.dll",
        "macos" => "lib_imf.dylib",
        _ => "lib_imf.so",
    }
}

/// A Python that serves.
fn interpreter() -> Result<String> {
    let python = env::var(INTERPRETER).unwrap_or_else(|_| "python3".to_owned());
    let serves = || Command::new(&python).args(["-c", PROBE]).status().is_ok_and(|status| status.success());
    PYTHON.provide(serves)?;
    Ok(python)
}

/// A virtual environment below `target`, with what the tests need.
struct Environment(PathBuf);

impl Environment {
    fn new(name: &str, python: &str) -> Result<Self> {
        let environment = Self(target().join(name));
        // A new one where there is none, or where its interpreter is gone.
        if !environment.executable().is_file() || environment.python(&["-c", PROBE]).is_err() {
            let folder = environment.0.to_string_lossy().into_owned();
            run_shown(Command::new(python).args(["-m", "venv", "--clear", &folder]))?;
        }
        let needed = package().join("tests/requirements.txt");
        environment.pip(&["-r", &needed.to_string_lossy()])?;
        Ok(environment)
    }

    fn executable(&self) -> PathBuf {
        self.0.join(if cfg!(windows) { "Scripts/python.exe" } else { "bin/python" })
    }

    fn python(&self, arguments: &[impl AsRef<OsStr>]) -> Result<()> {
        run_shown(Command::new(self.executable()).args(arguments))
    }

    fn pip(&self, arguments: &[&str]) -> Result<()> {
        let install = ["-m", "pip", "install", "--quiet", "--disable-pip-version-check"];
        self.python(&[&install[..], arguments].concat())
    }

    /// Puts the package's sources and the native module where the environment finds them.
    fn install_package(&self, module: &Path) -> Result<()> {
        let code = "import sysconfig; print(sysconfig.get_path('platlib'))";
        let asked = Command::new(self.executable()).args(["-c", code]).output()?;
        let packages = PathBuf::from(String::from_utf8_lossy(&asked.stdout).trim());
        let folder = packages.join("imf");
        if folder.exists() {
            fs::remove_dir_all(&folder).with_context(|| folder.display().to_string())?;
        }
        fs::create_dir_all(&folder).with_context(|| folder.display().to_string())?;
        for entry in fs::read_dir(package().join("python/imf"))? {
            let path = entry?.path();
            let is_source = path.extension().is_some_and(|ending| ending == "py" || ending == "pyi")
                || path.ends_with("py.typed");
            if is_source {
                fs::copy(&path, folder.join(path.file_name().unwrap_or_default()))?;
            }
        }
        let name = if cfg!(windows) { "_imf.pyd" } else { "_imf.abi3.so" };
        fs::copy(module, folder.join(name)).with_context(|| module.display().to_string())?;
        Ok(())
    }

    fn test(&self) -> Result<()> {
        let folder = package();
        let mut tests = Command::new(self.executable());
        // Where nothing but the environment is on the path.
        tests.args(["-m", "pytest", "--durations=5", "-p", "no:cacheprovider"]).current_dir(folder);
        run_shown(tests.env_remove("PYTHONPATH").env("PYTHONDONTWRITEBYTECODE", "1"))
    }
}

//! Is there a Vulkan driver for the GPU tests? Where there is none, Mesa's software Vulkan serves.
//!
//! Only Linux is looked at: Metal and Direct3D 12 come with the system. A driver is a manifest (`*.json`) in one of the
//! loader's folders or named by its variables, and the loader itself, `libvulkan.so.1`.

use std::env;
use std::ffi::OsStr;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, Result, bail, ensure};

const OPT_OUT: &str = "IMF_NO_GPU_TESTS";
const LOADER: &str = "libvulkan.so.1";
const MANIFEST_FOLDERS: [&str; 5] = [
    "/usr/share/vulkan/icd.d",
    "/etc/vulkan/icd.d",
    "/usr/local/share/vulkan/icd.d",
    "/usr/local/etc/vulkan/icd.d",
    "/run/opengl-driver/share/vulkan/icd.d",
];
const LIBRARY_FOLDERS: [&str; 8] = [
    "/usr/lib",
    "/usr/lib64",
    "/usr/local/lib",
    "/lib",
    "/usr/lib/x86_64-linux-gnu",
    "/usr/lib/aarch64-linux-gnu",
    "/usr/local/lib64",
    "/run/opengl-driver/lib",
];
const DEBIAN_INSTALL: &str = "apt-get install -y --no-install-recommends mesa-vulkan-drivers libvulkan1";

/// Sees to it that the GPU tests find a driver: looks, installs Mesa's as root on Debian and Ubuntu, else says what to
/// type.
///
/// # Errors
/// No driver, and none that could be installed.
pub(crate) fn ensure_driver() -> Result<()> {
    if env::var(OPT_OUT).is_ok_and(|value| value == "1") {
        println!("{OPT_OUT} is set: tests that need a GPU driver are reported as ignored");
        return Ok(());
    }
    if !cfg!(target_os = "linux") {
        println!("not Linux: the system brings its own GPU interface");
        return Ok(());
    }
    match look() {
        Ok(found) => {
            println!("{found}");
            return Ok(());
        }
        Err(missing) => println!("{missing}"),
    }
    if let Some(variable) = replacing_variable().filter(|_| manifests(&manifest_places()).is_empty()) {
        bail!("{variable} is set and names no Vulkan driver that is there; unset it or set it right");
    }
    let family = fs::read_to_string("/etc/os-release").map_or(Family::Other, |text| Family::of(&text));
    if family == Family::Debian && is_root() {
        install_on_debian()?;
        let found = look().map_err(|missing| anyhow::anyhow!("after the installation, {missing}"))?;
        println!("{found}");
        return Ok(());
    }
    bail!(
        "no Vulkan driver for the GPU tests; install Mesa's software driver with\n    {}\nor leave these tests out \
         with\n    {OPT_OUT}=1 cargo xtask test",
        family.remedy()
    )
}

/// What was found, or what is missing, in a sentence.
fn look() -> Result<String, String> {
    let names: Vec<String> =
        manifests(&manifest_places()).iter().map(|manifest| manifest.display().to_string()).collect();
    if names.is_empty() {
        return Err("no Vulkan driver found".to_owned());
    }
    if !loader_found() {
        return Err(format!("the Vulkan loader {LOADER} is not found"));
    }
    Ok(format!("Vulkan drivers: {}", names.join(", ")))
}

/// The variable, if one is set, that replaces the loader's own search.
fn replacing_variable() -> Option<&'static str> {
    let is_set = |variable: &&str| env::var_os(variable).is_some_and(|value| !value.is_empty());
    ["VK_DRIVER_FILES", "VK_ICD_FILENAMES"].into_iter().find(is_set)
}

/// Files and folders where the loader looks. Variables that replace its search come alone.
fn manifest_places() -> Vec<PathBuf> {
    if let Some(value) = replacing_variable().and_then(env::var_os) {
        return env::split_paths(&value).collect();
    }
    let mut places: Vec<PathBuf> = MANIFEST_FOLDERS.iter().map(PathBuf::from).collect();
    if let Some(added) = env::var_os("VK_ADD_DRIVER_FILES") {
        places.extend(env::split_paths(&added));
    }
    if let Some(home) = env::var_os("HOME") {
        places.push(Path::new(&home).join(".local/share/vulkan/icd.d"));
    }
    places
}

/// The manifests among `places`: files as they are, folders searched for `*.json`.
fn manifests(places: &[PathBuf]) -> Vec<PathBuf> {
    let is_manifest = |path: &Path| path.is_file() && path.extension() == Some(OsStr::new("json"));
    let mut found = Vec::new();
    for place in places {
        if is_manifest(place) {
            found.push(place.clone());
        } else if let Ok(entries) = fs::read_dir(place) {
            let mut files: Vec<PathBuf> =
                entries.filter_map(|entry| entry.ok().map(|entry| entry.path())).collect();
            files.sort();
            found.extend(files.into_iter().filter(|path| is_manifest(path)));
        }
    }
    found
}

fn loader_found() -> bool {
    let listed = ["ldconfig", "/sbin/ldconfig", "/usr/sbin/ldconfig"].iter().any(|program| {
        Command::new(program)
            .arg("-p")
            .output()
            .is_ok_and(|output| String::from_utf8_lossy(&output.stdout).contains(LOADER))
    });
    let library_path = env::var_os("LD_LIBRARY_PATH").unwrap_or_default();
    listed
        || LIBRARY_FOLDERS.iter().any(|folder| Path::new(folder).join(LOADER).exists())
        || env::split_paths(&library_path).any(|folder| folder.join(LOADER).exists())
}

/// Families of Linux distributions by their package manager.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Family {
    Debian,
    Fedora,
    Arch,
    Other,
}

impl Family {
    /// Reads `ID` and `ID_LIKE` from the text of `/etc/os-release`.
    fn of(os_release: &str) -> Self {
        let words = os_release
            .lines()
            .filter_map(|line| line.strip_prefix("ID=").or_else(|| line.strip_prefix("ID_LIKE=")))
            .flat_map(|value| value.trim().trim_matches(['"', '\'']).split_whitespace());
        for word in words {
            match word {
                "debian" | "ubuntu" => return Self::Debian,
                "fedora" | "rhel" | "centos" => return Self::Fedora,
                "arch" => return Self::Arch,
                _ => {}
            }
        }
        Self::Other
    }

    /// The one line to type.
    fn remedy(self) -> String {
        match self {
            Self::Debian => format!("sudo apt-get update && sudo {DEBIAN_INSTALL}"),
            Self::Fedora => "sudo dnf install -y mesa-vulkan-drivers vulkan-loader".to_owned(),
            Self::Arch => "sudo pacman -S --needed vulkan-swrast vulkan-icd-loader".to_owned(),
            Self::Other => {
                "(your package manager's Mesa Vulkan drivers, with lavapipe, and its Vulkan loader)"
                    .to_owned()
            }
        }
    }
}

fn is_root() -> bool {
    Command::new("id").arg("-u").output().is_ok_and(|output| output.stdout.trim_ascii() == b"0")
}

fn install_on_debian() -> Result<()> {
    for line in ["apt-get update", DEBIAN_INSTALL] {
        println!("$ {line}");
        let mut words = line.split_whitespace();
        let program = words.next().unwrap_or_default();
        let status = Command::new(program)
            .args(words)
            .env("DEBIAN_FRONTEND", "noninteractive")
            .status()
            .with_context(|| format!("cannot start {program}"))?;
        ensure!(
            status.success(),
            "`{line}` failed ({status}); with {OPT_OUT}=1 tests that need a GPU driver are left out"
        );
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn families_are_read_from_id_and_id_like() {
        assert_eq!(Family::of("NAME=\"Debian GNU/Linux\"\nID=debian\n"), Family::Debian);
        assert_eq!(Family::of("ID=linuxmint\nID_LIKE=\"ubuntu debian\"\n"), Family::Debian);
        assert_eq!(Family::of("ID=\"rocky\"\nID_LIKE=\"rhel centos fedora\"\n"), Family::Fedora);
        assert_eq!(Family::of("ID=manjaro\nID_LIKE=arch\n"), Family::Arch);
        assert_eq!(Family::of("VERSION_ID=12\nVARIANT_ID=debian\n"), Family::Other);
    }

    #[test]
    fn manifests_are_files_or_json_files_in_folders() {
        let folder = env::temp_dir().join(format!("imf-xtask-manifests-{}", std::process::id()));
        fs::create_dir_all(&folder).unwrap();
        let driver = folder.join("b_icd.json");
        fs::write(&driver, "{}").unwrap();
        fs::write(folder.join("a.txt"), "").unwrap();
        let places = [folder.clone(), folder.join("a.txt"), driver.clone(), folder.join("missing")];
        assert_eq!(manifests(&places), [driver.clone(), driver]);
        fs::remove_dir_all(&folder).unwrap();
    }
}

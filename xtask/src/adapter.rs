//! Is there a Vulkan driver for the GPU tests? Where there is none, Mesa's software Vulkan serves.
//!
//! Only Linux is looked at: Metal and Direct3D 12 come with the system. A driver is a manifest (`*.json`) in one of the
//! loader's folders or named by its variables, and the loader itself, `libvulkan.so.1`.

use std::env;
use std::ffi::OsStr;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Result, bail, ensure};

use crate::debian;

const OPT_OUT: &str = "IMF_NO_GPU_TESTS";
const LOADER: &str = "libvulkan.so.1";
/// Variables that name manifests; the last one adds to what is found, the others replace it.
const VARIABLES: [&str; 3] = ["VK_DRIVER_FILES", "VK_ICD_FILENAMES", "VK_ADD_DRIVER_FILES"];
const MANIFEST_FOLDERS: [&str; 5] = [
    "/usr/share/vulkan/icd.d",
    "/etc/vulkan/icd.d",
    "/usr/local/share/vulkan/icd.d",
    "/usr/local/etc/vulkan/icd.d",
    "/run/opengl-driver/share/vulkan/icd.d",
];
const LIBRARY_FOLDERS: [&str; 4] = ["/usr/lib", "/usr/lib64", "/usr/local/lib", "/run/opengl-driver/lib"];
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
    let found = manifests(&manifest_places());
    let has_loader = loader_found();
    if !found.is_empty() && has_loader {
        println!("Vulkan loader and driver manifests: {found:?}");
        return Ok(());
    }
    println!("Vulkan driver manifests: {found:?}; loader {LOADER}: {has_loader}");
    let set = VARIABLES[..2].iter().find(|name| env::var_os(name).is_some());
    if let Some(variable) = set.filter(|_| found.is_empty()) {
        bail!("{variable} is set and names no Vulkan driver that is there; unset it or set it right");
    }
    if debian::can_install() {
        debian::install(
            DEBIAN_INSTALL,
            &format!("with {OPT_OUT}=1 tests that need a GPU driver are left out"),
        )?;
        ensure!(loader_found() && !manifests(&manifest_places()).is_empty(), "still no Vulkan driver");
        return Ok(());
    }
    bail!(
        "GPU tests need a Vulkan driver; Mesa's software Vulkan will do. Install it:\n    \
         Debian, Ubuntu  sudo apt-get update && sudo {DEBIAN_INSTALL}\n    \
         Fedora          sudo dnf install -y mesa-vulkan-drivers vulkan-loader\n    \
         Arch            sudo pacman -S --needed vulkan-swrast vulkan-icd-loader\n\
         With {OPT_OUT}=1 tests that need a driver are left out"
    )
}

/// Files and folders where the loader looks.
fn manifest_places() -> Vec<PathBuf> {
    let named = |name: &&str| env::var_os(name).filter(|value| !value.is_empty());
    if let Some(value) = VARIABLES[..2].iter().find_map(named) {
        return env::split_paths(&value).collect();
    }
    let mut places: Vec<PathBuf> = MANIFEST_FOLDERS.iter().map(PathBuf::from).collect();
    places.extend(named(&VARIABLES[2]).iter().flat_map(env::split_paths));
    places.extend(env::var_os("HOME").map(|home| Path::new(&home).join(".local/share/vulkan/icd.d")));
    places
}

/// The manifests among `places`: files as they are, folders searched for `*.json`.
fn manifests(places: &[PathBuf]) -> Vec<PathBuf> {
    let is_manifest = |path: &PathBuf| path.is_file() && path.extension() == Some(OsStr::new("json"));
    let inside = |place: &PathBuf| match fs::read_dir(place) {
        Ok(entries) => entries.filter_map(|entry| Some(entry.ok()?.path())).collect(),
        Err(_) => vec![place.clone()],
    };
    places.iter().flat_map(inside).filter(is_manifest).collect()
}

fn loader_found() -> bool {
    let listed = ["ldconfig", "/sbin/ldconfig"].iter().any(|program| {
        let output = Command::new(program).arg("-p").output();
        output.is_ok_and(|output| String::from_utf8_lossy(&output.stdout).contains(LOADER))
    });
    let library_path = env::var_os("LD_LIBRARY_PATH").unwrap_or_default();
    let mut folders = env::split_paths(&library_path).chain(LIBRARY_FOLDERS.iter().map(PathBuf::from));
    listed || folders.any(|folder| folder.join(LOADER).exists())
}

#[cfg(test)]
mod tests {
    use super::*;

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

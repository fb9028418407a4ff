//! Is there a Vulkan driver for the GPU tests? Where there is none, Mesa's software Vulkan serves.
//!
//! Only Linux is looked at: Metal and Direct3D 12 come with the system. A driver is a manifest in one of the loader's folders, and the loader
//! itself, or what one of its variables names; whether it works, the tests say.

use std::process::Command;
use std::{env, fs};

use anyhow::Result;

use crate::debian::Need;

const LOADER: &str = "libvulkan.so.1";
/// Variables that name manifests.
const VARIABLES: [&str; 3] = ["VK_DRIVER_FILES", "VK_ICD_FILENAMES", "VK_ADD_DRIVER_FILES"];
const FOLDERS: [&str; 5] = [
    "/usr/share/vulkan/icd.d",
    "/etc/vulkan/icd.d",
    "/usr/local/share/vulkan/icd.d",
    "/usr/local/etc/vulkan/icd.d",
    "/run/opengl-driver/share/vulkan/icd.d",
];
const DRIVER: Need = Need {
    sentence: "GPU tests need a Vulkan driver; Mesa's software Vulkan will do (Fedora: sudo dnf install -y mesa-vulkan-drivers \
               vulkan-loader; Arch: sudo pacman -S --needed vulkan-swrast vulkan-icd-loader)",
    packages: &["mesa-vulkan-drivers", "libvulkan1"],
    opt_out: "IMF_NO_GPU_TESTS",
};

/// Sees to it that the GPU tests find a driver.
///
/// # Errors
/// No driver, and none that could be installed.
pub(crate) fn ensure_driver() -> Result<()> {
    if !cfg!(target_os = "linux") {
        println!("not Linux: the system brings its own GPU interface");
        return Ok(());
    }
    if DRIVER.is_left_out() { Ok(()) } else { DRIVER.provide(has_driver) }
}

fn has_driver() -> bool {
    let holds_any = |folder: &&str| fs::read_dir(folder).is_ok_and(|mut files| files.next().is_some());
    // A container with a card's own driver may lack it. Not every system lists its libraries.
    let lacks_loader = Command::new("/sbin/ldconfig")
        .arg("-p")
        .output()
        .is_ok_and(|listed| !String::from_utf8_lossy(&listed.stdout).contains(LOADER));
    let is_named = VARIABLES.iter().any(|name| env::var_os(name).is_some_and(|value| !value.is_empty()));
    is_named || (!lacks_loader && FOLDERS.iter().any(holds_any))
}

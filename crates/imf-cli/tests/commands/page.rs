//! The page in 3D, in a headless Chromium; `IMF_NO_BROWSER_TESTS=1` leaves it out.

use std::path::{Path, PathBuf};
use std::process::Command;

use image::RgbImage;

use crate::binary::Workdir;

/// A tool whose holder comes down beside the part before its cutter reaches far.
const MILL: &str = r#"
name = "short mill"
unit = "mm"
stick_out = 15.0
cutter = { shape = "flat", diameter = 10.0, length = 12.0 }
shank = { diameter = 10.0 }
holder = [{ diameter = 40.0, length = 40.0 }]
"#;

fn browser() -> PathBuf {
    let named = ["chromium", "chromium-browser", "google-chrome", "chrome"];
    let path = std::env::var_os("PATH").unwrap_or_default();
    let mut places = std::env::split_paths(&path).flat_map(|folder| named.map(|name| folder.join(name)));
    places.find(|place| place.is_file()).expect(
        "there is no Chromium: install it (Debian: apt-get install chromium), or leave this test out on purpose: \
         IMF_NO_BROWSER_TESTS=1 cargo test",
    )
}

/// What the page looks like, and what its console says.
fn look(page: &Path, picture: &Path) -> (RgbImage, String) {
    let profile = tempfile::tempdir().unwrap();
    let output = Command::new(browser())
        .args(["--headless", "--no-sandbox", "--disable-quic", "--no-first-run", "--disable-sync"])
        .args(["--disable-background-networking", "--disable-component-update", "--disable-extensions"])
        // WebGL without a graphics card.
        .args(["--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--hide-scrollbars"])
        .args(["--window-size=1200,800", "--virtual-time-budget=10000", "--enable-logging=stderr"])
        .arg(format!("--user-data-dir={}", profile.path().display()))
        .arg(format!("--screenshot={}", picture.display()))
        .arg(format!("file://{}", page.display()))
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.success(), "{said}");
    let console: String = said.lines().filter(|line| line.contains("CONSOLE")).collect();
    (image::open(picture).unwrap().to_rgb8(), console)
}

#[test]
#[cfg_attr(no_browser_tests, ignore = "IMF_NO_BROWSER_TESTS is set")]
fn the_page_shows_the_surface_and_a_click_colours_it_by_tool() {
    let folder = Workdir::new();
    folder.write("short.toml", MILL);
    folder.write("long.toml", MILL.replace("short", "long").replace("15.0", "70.0"));
    let scene = "access bracket --pitch 6 --orientations axes --tool short.toml --tool long.toml";
    let run = format!("{scene} --html page/report.html --out out");
    folder.imf(&run).done();
    let text = folder.text("page/report.html");
    let (plain, console) = look(&folder.path("page/report.html"), &folder.path("plain.png"));
    assert_eq!(console, "");
    // The left part is the view: the part's own colours on the background.
    let view = |image: &RgbImage| -> Vec<[u8; 3]> {
        image.enumerate_pixels().filter(|(x, ..)| *x < 600).map(|(.., pixel)| pixel.0).collect()
    };
    let plain = view(&plain);
    let greenish =
        plain.iter().filter(|[r, g, b]| *g > 90 && u16::from(*g) > u16::from(*r) + 20 && g > b).count();
    assert!(greenish > plain.len() / 50, "{greenish} of {} pixels show a reached surface", plain.len());
    let click = "<script>document.querySelector('button[data-by=tool]').click();</script></body>";
    folder.write("clicked.html", text.replace("</body>", click));
    let (by_tool, console) = look(&folder.path("clicked.html"), &folder.path("clicked.png"));
    assert_eq!(console, "");
    let changed = view(&by_tool).iter().zip(&plain).filter(|(one, other)| one != other).count();
    assert!(changed > plain.len() / 50, "{changed} of {} pixels changed", plain.len());
}

#[test]
#[cfg_attr(no_browser_tests, ignore = "IMF_NO_BROWSER_TESTS is set")]
fn the_page_of_a_check_shows_the_line_that_collides_in_red() {
    let folder = Workdir::new();
    // Over the bracket, through it, and away.
    folder.write("path.csv", "x,y,z\n24,-40,120\n24,73,120\n24,73,40\n24,190,120\n");
    let run = folder.imf("check bracket path.csv --tool paper --pitch 4 --html page.html").exits(3);
    run.warns(&["page.html"]);
    let (page, console) = look(&folder.path("page.html"), &folder.path("page.png"));
    assert_eq!(console, "");
    let is_red = |[r, g, b]: [u8; 3]| r > 150 && g < 90 && b < 90;
    let red = page.enumerate_pixels().filter(|(x, _, pixel)| *x < 600 && is_red(pixel.0)).count();
    assert!(red > 30, "{red} red pixels");
}

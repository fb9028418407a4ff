//! `cargo xtask stress`: a training that is killed again and again ends where one in peace ends.
//!
//! A small network is trained once in one go, then once more while the process is killed (SIGKILL, which no program can
//! see coming) at random moments drawn from a seed and resumed each time. Both must leave the same bytes: weights,
//! moments, loss curve, held-out error, everything but the seconds that training took and the checksum over them.

use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use anyhow::{Context, Result, bail, ensure};

use crate::checks;

/// A kill comes at most this long after the start of the process.
const LATEST_KILL: Duration = Duration::from_millis(900);
const DATASET: &str = "dataset bracket --dims 7,21,12 --orientations fibonacci:16 --out data";
const TRAIN: &str = "train siren5 data --rate 1e-3 --set schedule=cosine --set checkpoint_every=0.02 \
                     --set held_out=512 --quiet";

/// What to do.
pub(crate) struct Stress {
    kills: u64,
    device: String,
    seed: u64,
}

impl Stress {
    /// Reads `--kills N`, `--device cpu|software` and `--seed S`.
    ///
    /// # Errors
    /// Anything else.
    pub(crate) fn parse(arguments: &[&str]) -> Result<Self> {
        let mut stress = Self { kills: 50, device: "cpu".into(), seed: 1 };
        for pair in arguments.chunks(2) {
            match *pair {
                ["--kills", n] => stress.kills = n.parse().context("--kills takes a number")?,
                ["--device", device] => stress.device = device.into(),
                ["--seed", seed] => stress.seed = seed.parse().context("--seed takes a number")?,
                _ => bail!("stress takes --kills N, --device cpu|software and --seed S, not {pair:?}"),
            }
        }
        Ok(stress)
    }

    /// Runs it.
    ///
    /// # Errors
    /// A run that fails, or bytes that differ.
    pub(crate) fn run(mut self) -> Result<()> {
        let imf = checks::build_imf()?;
        let folder = std::env::temp_dir().join(format!("imf-stress-{}", std::process::id()));
        std::fs::create_dir_all(&folder)?;
        let work = Workplace { imf, folder };
        work.run_through(DATASET)?;
        // Some seconds on either; a step of software Vulkan takes longer.
        let size = if self.device == "cpu" {
            "--network 3x64:10 --batch 512 --steps 20000"
        } else {
            "--network 3x24:10 --batch 128 --steps 1500"
        };
        let train = format!("{TRAIN} {size} --device {}", self.device);
        let begun = Instant::now();
        work.run_through(&format!("{train} --out whole"))?;
        println!("one run in peace: {:.1} s", begun.elapsed().as_secs_f64());
        let whole = work.outcome("whole")?;
        let (mut kills, mut rounds, mut resumed) = (0, 0, 0);
        while kills < self.kills {
            rounds += 1;
            let out = format!("round-{rounds}");
            loop {
                let checkpoint = work.folder.join(&out).join("checkpoint.safetensors");
                let is_resumed = checkpoint.exists();
                let resume = if is_resumed { "--resume" } else { "" };
                let child = work.start(&format!("{train} --out {out} {resume}"))?;
                resumed += u64::from(is_resumed);
                let patience = if kills < self.kills { self.moment() } else { Duration::from_secs(3600) };
                if finished_within(child, patience)? {
                    break;
                }
                kills += 1;
            }
            ensure!(
                work.outcome(&out)? == whole,
                "{out} ended with other bytes than the run in peace; both are kept in {}",
                work.folder.display()
            );
            println!("round {rounds}: {kills} kills so far, {resumed} resumed, the same bytes at the end");
        }
        println!("{kills} kills on {} in {rounds} rounds (seed {}), no byte differs", self.device, self.seed);
        std::fs::remove_dir_all(&work.folder)?;
        Ok(())
    }

    /// The next moment to kill at (SplitMix64).
    fn moment(&mut self) -> Duration {
        self.seed = self.seed.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mixed = (self.seed ^ self.seed >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let mixed = (mixed ^ mixed >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
        LATEST_KILL.mul_f64(((mixed ^ mixed >> 31) >> 11) as f64 / (1u64 << 53) as f64)
    }
}

/// Where the command runs.
struct Workplace {
    imf: PathBuf,
    folder: PathBuf,
}

impl Workplace {
    fn start(&self, line: &str) -> Result<Child> {
        Command::new(&self.imf)
            .args(line.split_whitespace())
            .current_dir(&self.folder)
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .spawn()
            .with_context(|| format!("cannot start {}", self.imf.display()))
    }

    fn run_through(&self, line: &str) -> Result<()> {
        let status = self.start(line)?.wait()?;
        ensure!(status.success(), "`imf {line}` failed ({status})");
        Ok(())
    }

    /// What a training left, without the seconds it took.
    fn outcome(&self, out: &str) -> Result<Vec<Vec<u8>>> {
        let folder = self.folder.join(out);
        ["field.safetensors", "checkpoint.safetensors"]
            .map(|name| timeless(&folder.join(name)))
            .into_iter()
            .collect()
    }
}

/// The bytes of a model without its seconds, its checksum, and the header's length and padding that follow from them.
fn timeless(path: &Path) -> Result<Vec<u8>> {
    let bytes = std::fs::read(path).with_context(|| format!("cannot read {}", path.display()))?;
    let length = bytes.first_chunk::<8>().context("a model of less than eight bytes")?;
    let header = 8 + usize::try_from(u64::from_le_bytes(*length))?;
    let text = std::str::from_utf8(bytes.get(8..header).context("a header cut short")?)?;
    let mut kept = text.trim_end().to_owned();
    for key in [r#"\"seconds\":"#, r#"\"crc32\":"#] {
        let start = kept.find(key).with_context(|| format!("no {key} in {}", path.display()))?;
        let end = kept[start..].find(',').context("a key that ends the header")? + start;
        kept.replace_range(start..end, "");
    }
    Ok([kept.as_bytes(), &bytes[header..]].concat())
}

/// True where the process ended by itself; otherwise it is killed.
fn finished_within(mut child: Child, patience: Duration) -> Result<bool> {
    let begun = Instant::now();
    while begun.elapsed() < patience {
        if let Some(status) = child.try_wait()? {
            ensure!(status.success(), "a run failed by itself ({status})");
            return Ok(true);
        }
        std::thread::sleep(Duration::from_millis(1));
    }
    child.kill()?;
    let status = child.wait()?;
    // It may have ended just before the kill.
    Ok(status.success())
}

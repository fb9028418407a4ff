//! Progress with a rate and the time left: a live line on a terminal, a line every few seconds elsewhere.

use std::io::IsTerminal;
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressStyle};

use crate::output::eprint_line;

/// Time between lines where there is no terminal.
const LINE_EVERY: Duration = Duration::from_secs(5);

/// A brief stage is shown where it takes longer.
const BRIEF: Duration = Duration::from_secs(1);

/// One stage of the work.
pub struct Stage {
    name: String,
    unit: &'static str,
    total: u64,
    done: AtomicU64,
    /// Units of an earlier run.
    before: u64,
    /// Units that are nobody's work here.
    passed_over: AtomicU64,
    start: Instant,
    bar: Option<ProgressBar>,
    last_line: Option<Mutex<Instant>>,
    /// Not shown where it takes no longer than [`BRIEF`].
    pub(crate) brief: bool,
}

impl Stage {
    pub(crate) fn new(name: &str, unit: &'static str, total: u64, quiet: bool) -> Self {
        let terminal = std::io::stderr().is_terminal();
        let bar = (terminal && !quiet).then(|| {
            let bar = ProgressBar::new(total);
            let template = "{msg:<22} {wide_bar} {human_pos}/{human_len} {per_sec} left {eta}";
            if let Ok(style) = ProgressStyle::with_template(template) {
                bar.set_style(style);
            }
            bar.set_message(name.to_owned());
            bar
        });
        let start = Instant::now();
        let last_line = (!terminal && !quiet).then(|| Mutex::new(start));
        let (name, [done, passed_over]) = (name.to_owned(), [0, 0].map(AtomicU64::new));
        Self { name, unit, total, done, before: 0, passed_over, start, bar, last_line, brief: false }
    }

    /// Units that were finished before: they count as done, not for the rate.
    pub(crate) fn begin_at(&mut self, units: u64) {
        self.before = units;
        self.done.store(units, Ordering::Relaxed);
        if let Some(bar) = &self.bar {
            bar.set_position(units);
            bar.reset_eta();
        }
    }

    /// Units that need no work: they count neither as done nor for the rate.
    pub(crate) fn pass_over(&self, units: u64) {
        self.passed_over.fetch_add(units, Ordering::Relaxed);
        if let Some(bar) = &self.bar {
            bar.set_length(self.left());
        }
    }

    /// All units but those that need no work.
    fn left(&self) -> u64 {
        self.total.saturating_sub(self.passed_over.load(Ordering::Relaxed))
    }

    /// More units are finished; callable from any thread.
    pub fn advance(&self, units: u64) {
        self.advance_saying(units, "");
    }

    /// More units are finished; `remark` is shown beside them, such as the loss.
    pub(crate) fn advance_saying(&self, units: u64, remark: &str) {
        let done = self.done.fetch_add(units, Ordering::Relaxed) + units;
        if let Some(bar) = &self.bar {
            bar.set_position(done);
            if !remark.is_empty() {
                bar.set_message(format!("{} {remark}", self.name));
            }
        }
        let Some(last_line) = &self.last_line else { return };
        let Ok(mut last) = last_line.lock() else { return };
        let total = self.left();
        if last.elapsed() >= LINE_EVERY && done < total {
            *last = Instant::now();
            let rate = (done - self.before) as f64 / self.start.elapsed().as_secs_f64();
            let left = total.saturating_sub(done) as f64 / rate.max(1e-9);
            let Self { name, unit, .. } = self;
            let (rate, left) = (show_rate(rate), show_seconds(left));
            eprint_line(format_args!("{name}: {done} of {total} {unit}, {rate}/s, {left} left {remark}"));
        }
    }

    /// Ends the stage with one line that stays.
    pub fn finish(self, result: &str) {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
        let is_told = !self.brief || self.start.elapsed() > BRIEF;
        if is_told && (self.bar.is_some() || self.last_line.is_some()) {
            let seconds = self.start.elapsed().as_secs_f64();
            let done = self.done.load(Ordering::Relaxed);
            let rate = (done - self.before) as f64 / seconds.max(1e-9);
            let comma = if result.is_empty() { "" } else { "; " };
            let Self { name, unit, .. } = &self;
            let (time, rate) = (show_seconds(seconds), show_rate(rate));
            eprint_line(format_args!("{name}: {done} {unit} in {time} ({rate}/s){comma}{result}"));
        }
    }
}

/// A rate in four digits or so.
fn show_rate(rate: f64) -> String {
    if rate < 1e3 {
        format!("{rate:.1}")
    } else if rate < 1e6 {
        format!("{rate:.0}")
    } else {
        format!("{:.1} million", rate / 1e6)
    }
}

/// Seconds in words.
pub fn show_seconds(seconds: f64) -> String {
    if seconds < 10.0 {
        format!("{seconds:.1} s")
    } else if seconds < 120.0 {
        format!("{seconds:.0} s")
    } else if seconds < 7200.0 {
        format!("{:.0} min {:02.0} s", (seconds / 60.0).floor(), seconds % 60.0)
    } else {
        format!("{:.0} h {:02.0} min", (seconds / 3600.0).floor(), (seconds % 3600.0) / 60.0)
    }
}

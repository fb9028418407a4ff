//! A pool of the latest sections: while training runs, a second thread makes fresh ones, and each replaces the oldest.
//!
//! What section `n` is follows from `n` alone. At step `s` the pool holds the [`OnlineSettings::pool`] sections up to
//! `pool − 1 + s / every`, so a run can be repeated, and resumed from the step alone: the pool is computed anew. A trainer that
//! comes too early waits, and so does a producer that is [`OnlineSettings::lead`] sections ahead.

use std::ops::RangeInclusive;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};

use imf_core::control::Cancelled;
use imf_core::section::SectionError;
use imf_fields::recipe::OnlineSettings;

/// What a producer makes of a number.
type SectionResult<S> = Result<S, SectionError>;

/// Computes, on a second thread, the sections that a training from step `first` to step `last` meets, while `train`
/// takes them. While the pool fills, `stop` is polled before each section.
pub(crate) fn with_arrivals<S: Send, T>(
    settings: OnlineSettings,
    [first, last]: [u64; 2],
    make: impl FnMut(u64) -> SectionResult<S> + Send,
    stop: &dyn Fn() -> bool,
    train: impl FnOnce(&mut Arrivals<'_, S>) -> T,
) -> T {
    let oldest = settings.newest(first) + 1 - settings.pool as u64;
    let numbers = oldest..=settings.newest(last.max(first));
    std::thread::scope(|scope| {
        let (sender, receiver) = sync_channel(settings.lead);
        let producer = scope.spawn(move || produce(numbers, make, &sender));
        let pool = (0..settings.pool).map(|_| None).collect();
        let mut arrivals = Arrivals { receiver: &receiver, settings, stop, first, next: oldest, pool };
        let trained = train(&mut arrivals);
        // A producer that still has work stops once nobody takes it.
        drop(receiver);
        producer.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic));
        trained
    })
}

/// Makes `numbers` one after the other until nobody wants them.
fn produce<S>(
    numbers: RangeInclusive<u64>,
    mut make: impl FnMut(u64) -> SectionResult<S>,
    sender: &SyncSender<SectionResult<S>>,
) {
    for number in numbers {
        let section = make(number);
        let failed = section.is_err();
        if sender.send(section).is_err() || failed {
            break;
        }
    }
}

/// The latest of what was made; number `n` stands in slot `n mod pool`.
pub(crate) struct Arrivals<'a, S> {
    receiver: &'a Receiver<SectionResult<S>>,
    settings: OnlineSettings,
    stop: &'a dyn Fn() -> bool,
    /// Step at which the pool is filled.
    first: u64,
    /// Number to be received next.
    next: u64,
    pool: Vec<Option<S>>,
}

impl<S> Arrivals<'_, S> {
    /// Waits for what the pool holds at a step: that, slot after slot, none of them empty. A pool that is filled for the first
    /// time, which may take minutes, is given up where `stop` says so: nothing was learnt from it yet.
    pub(crate) fn at(&mut self, step: u64) -> Result<&[Option<S>], SectionError> {
        while self.next <= self.settings.newest(step) {
            if step == self.first && (self.stop)() {
                return Err(Cancelled.into());
            }
            // A producer that is gone has panicked, which is passed on when it is joined.
            let made = self.receiver.recv().unwrap_or(Err(Cancelled.into()))?;
            self.pool[(self.next % self.settings.pool as u64) as usize] = Some(made);
            self.next += 1;
        }
        Ok(&self.pool)
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

    use super::*;

    const SETTINGS: OnlineSettings = OnlineSettings { pool: 5, every: 3, seed: 4, lead: 2 };

    #[test]
    fn the_pool_holds_the_latest_and_no_more_are_made_than_are_met() {
        let made = AtomicU64::new(0);
        let make = |number| {
            made.fetch_add(1, Ordering::Relaxed);
            Ok(number)
        };
        // Resumed at step 7: sections 2 to 6 first.
        with_arrivals(SETTINGS, [7, 59], make, &|| false, |arrivals| {
            for step in 7..60 {
                let newest = SETTINGS.newest(step);
                let mut pool: Vec<u64> = arrivals.at(step).unwrap().iter().flatten().copied().collect();
                assert!(pool.iter().enumerate().all(|(slot, number)| number % 5 == slot as u64), "{pool:?}");
                pool.sort_unstable();
                assert_eq!(pool, (newest - 4..=newest).collect::<Vec<_>>(), "step {step}");
            }
        });
        // Steps 7 to 59 meet sections 2 to 4 + 59 / 3.
        assert_eq!(made.into_inner(), 5 + 17);
    }

    #[test]
    fn settings_that_stand_still_are_refused() {
        for settings in [
            OnlineSettings { pool: 0, ..SETTINGS },
            OnlineSettings { every: 0, ..SETTINGS },
            OnlineSettings { lead: 0, ..SETTINGS },
        ] {
            assert!(settings.check().is_err(), "{settings:?}");
        }
        assert!(serde_json::from_str::<OnlineSettings>(r#"{"pol": 3}"#).is_err());
    }

    #[test]
    fn a_pool_that_fills_is_given_up_when_that_is_wished() {
        let cancelled = AtomicBool::new(false);
        let made = AtomicU64::new(0);
        // The wish comes while the second of five sections is made.
        let make = |number| {
            made.store(number + 1, Ordering::Relaxed);
            cancelled.fetch_or(number == 1, Ordering::Relaxed);
            Ok(number)
        };
        let stop = || cancelled.load(Ordering::Relaxed);
        let settings = OnlineSettings { lead: 1, ..SETTINGS };
        let taken = with_arrivals(settings, [0, 60], make, &stop, |arrivals| arrivals.at(0).map(<[_]>::len));
        assert!(matches!(taken, Err(SectionError::Cancelled(_))), "{taken:?}");
        // The two that were taken, the one that may be ahead, and the one after it, which found no taker.
        assert!(made.load(Ordering::Relaxed) <= 4, "{made:?} of {} were made", settings.pool);
    }
}

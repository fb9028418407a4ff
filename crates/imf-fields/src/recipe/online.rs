//! How sections come and go in online training.

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng as _, SeedableRng as _};
use serde::{Deserialize, Serialize};

use super::RecipeError;
use imf_core::orientation::Orientation;

/// How sections come and go.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct OnlineSettings {
    /// Sections in the pool.
    pub pool: usize,
    /// Steps from one fresh section to the next.
    pub every: u64,
    /// Seed of the orientations.
    pub seed: u64,
    /// Sections that the producer may be ahead.
    pub lead: usize,
}

impl Default for OnlineSettings {
    fn default() -> Self {
        Self { pool: 225, every: 1, seed: 0, lead: 16 }
    }
}

impl OnlineSettings {
    /// Checks that there is something in the pool and that it changes.
    ///
    /// # Errors
    /// [`RecipeError`], naming the value.
    pub fn check(&self) -> Result<(), RecipeError> {
        for (name, value) in [("pool", self.pool as u64), ("every", self.every), ("lead", self.lead as u64)] {
            if !(1..=1 << 40).contains(&value) {
                return Err(RecipeError(format!("online `{name}` must be at least 1, not {value}")));
            }
        }
        Ok(())
    }

    /// Number of the newest section in the pool at a step.
    #[must_use]
    pub fn newest(&self, step: u64) -> u64 {
        self.pool as u64 - 1 + step / self.every
    }

    /// Orientation of section `number`: uniform on the sphere.
    #[must_use]
    pub fn orientation(&self, number: u64) -> Orientation {
        let mut generator = ChaCha8Rng::seed_from_u64(self.seed);
        generator.set_stream(number);
        let mut unit = || (generator.next_u64() >> 11) as f64 / (1u64 << 53) as f64;
        let z = 2.0 * unit() - 1.0;
        Orientation::new(360.0 * unit(), z.acos().to_degrees())
    }

    /// As [`Self::orientation`] with a roll: uniform over the rotations.
    #[must_use]
    pub fn rotation(&self, number: u64) -> Orientation {
        let mut generator = ChaCha8Rng::seed_from_u64(!self.seed);
        generator.set_stream(number);
        let unit = (generator.next_u64() >> 11) as f64 / (1u64 << 53) as f64;
        Orientation { roll: 360.0 * unit, ..self.orientation(number) }
    }

    /// Numbers of what the pool holds at a step, slot after slot.
    pub fn slots(&self, step: u64) -> impl Iterator<Item = u64> {
        let pool = self.pool as u64;
        let oldest = self.newest(step) + 1 - pool;
        (0..pool).map(move |slot| oldest + (slot + pool - oldest % pool) % pool)
    }
}

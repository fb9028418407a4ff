//! How far the adapter may be from its twins, and why.

/// Values of networks. The rounding of an angle of a few units is some 1e-7 and grows by about √2 a layer with the starting
/// weights; the sigmoid divides it by four or more. Lavapipe is off by 1e-7 at most; another device may add up and take `exp`
/// otherwise.
pub(crate) const NETWORK: f64 = 2e-6;

/// A gradient in f32, of its largest entry: every layer adds the rounding of its angle, 2⁻²⁴·|ω·s| with |ω·s| of a few units, and
/// passes on that of the layers before; sums over the batch average it. Lavapipe is off by 1.1e-6 of the largest entry; ten times
/// that leaves room for other orders of the sums and other roundings.
pub(crate) const GRADIENT: f64 = 1e-5;

/// The same behind linear outputs, as of the CPU engine: some 100 units in the last place of the largest gradient.
pub(crate) const GRADIENT_LINEAR: f64 = 2e-5;

/// Sections and minima of factored fields of scale 1: coefficients of some units from sums of f32 in another order, and a product of
/// 21 of them.
pub(crate) const SECTIONS: f32 = 2e-5;

/// Weights that SOAP steps, in units of the learning rate. Twelve steps that each round weights of up to 0.5, by 3e-5 of the learning
/// rate, and gradients that differ by their own rounding. Another iteration, length or order of two averages parts them by more
/// than 0.1.
pub(crate) const SOAP: f32 = 2e-3;

/// How far answers to poses may be apart.
pub(crate) struct Within {
    /// Of values.
    pub(crate) value: f32,
    /// Of gradients, relative to the largest.
    pub(crate) slope: f32,
    /// Whether slopes mean something at the poles.
    pub(crate) poles: bool,
}

/// Factored and harmonic fields. Points and directions of single precision, seen by ω = 10 through three layers and by waves of degree
/// 16, and sums of some hundred products in another order: 1.5e-6 and 2.6e-6 were found.
pub(crate) const FUNCTIONS: Within = Within { value: 1e-5, slope: 2e-5, poles: true };

/// The paper's network. Angles of a few units in the last place, ω = 10 times through three layers. At the poles the slope in θ is
/// divided by 1e-3 and so is its rounding.
pub(crate) const SIREN: Within = Within { value: 2e-5, slope: 2e-4, poles: false };

//! All numbers that decide a verdict, with unit, meaning and origin; nothing in, the one set of
//! them out.
//!
//! `Thresholds::default()` is what a diagnosis runs with. It goes with the settings and is not read
//! from files: a user changes a verdict with the settings that are documented (their defaults stand
//! here too, in `defaults`), not with these. `scaled` halves and doubles one of them for the trials
//! that measure what it does: `docs/thresholds.md` has the outcome and the command.
//!
//! *Convention* marks a usual level that no data were asked about; *chosen* a number set, or
//! changed, with the data named in view; *first guess* one that came with its rule and was kept,
//! without a record of data that it was set by; *arithmetic* one that only has to be far from
//! rounding. "Lower" and "higher" say what is to be expected of a change; what was measured is in
//! the document.
//!
//! What is not here, and why: exact numbers of the theory (half a square, the mean of chi-square, a
//! dispersion of at least 1, the sign of a gain); rounding of the linear algebra
//! (`products::DEPENDENT`, the pivots of `products::factor`, the tolerance of
//! `gain::by_coordinates`); the ladder of damped steps of a fit (`fit::TRIES`) and sizes of loops,
//! which change the way and not the end; what is only words and digits (which base parameters are
//! told to imitate a candidate, 95% intervals); and the numbers of one effect (starts, bounds, what
//! physics expects), which stand in its file.

/// A value that can be made smaller or larger as a whole.
#[cfg(feature = "internals")]
trait Scale {
    fn times(&self, by: f64) -> Self;
    fn told(&self) -> String;
}

#[cfg(feature = "internals")]
impl Scale for f64 {
    fn times(&self, by: f64) -> f64 {
        self * by
    }
    /// To four digits behind the point, or all of what is smaller than that.
    fn told(&self) -> String {
        if *self < 1e-3 { format!("{self}") } else { format!("{}", (self * 1e4).round() / 1e4) }
    }
}

/// A count: to the nearest one, and at least 1.
#[cfg(feature = "internals")]
impl Scale for usize {
    fn times(&self, by: f64) -> usize {
        ((*self as f64 * by).round() as usize).max(1)
    }
    fn told(&self) -> String {
        format!("{self}")
    }
}

#[cfg(feature = "internals")]
impl<const N: usize> Scale for [f64; N] {
    fn times(&self, by: f64) -> [f64; N] {
        self.map(|v| v * by)
    }
    fn told(&self) -> String {
        self.map(|v| v.told()).join(", ")
    }
}

macro_rules! thresholds {
    ($($(#[doc = $doc:literal])+ $name:ident: $kind:ty = $value:expr, $unit:literal;)+) => {
        /// The numbers that decide.
        #[derive(Debug, Clone, PartialEq)]
        pub struct Thresholds {
            $($(#[doc = $doc])+ pub $name: $kind,)+
        }

        impl Default for Thresholds {
            fn default() -> Self {
                Thresholds { $($name: $value,)+ }
            }
        }

        // For the trials that halve and double each.
        #[cfg(feature = "internals")]
        impl Thresholds {
            /// With one of them multiplied by `by` (a count to the nearest one, a list as a whole);
            /// none where nothing has this name.
            pub fn scaled(&self, name: &str, by: f64) -> Option<Thresholds> {
                let mut all = self.clone();
                match name {
                    $(stringify!($name) => all.$name = self.$name.times(by),)+
                    _ => return None,
                }
                Some(all)
            }

            /// Name, value and unit of each, in the order of the file.
            pub fn told(&self) -> Vec<(&'static str, String, &'static str)> {
                vec![$((stringify!($name), self.$name.told(), $unit),)+]
            }
        }
    };
}

thresholds! {
    // ---- Screening: which candidates are looked at --------------------------------------------------------------------------------------

    /// Share of a candidate's sensitivity (sum of squares) that must be left once the base's free
    /// parameters are projected out; below it the candidate is collinear with them and no
    /// candidate. *Arithmetic*: far above rounding (1e-11), far below what data could tell. Lower:
    /// gains of rounding errors. Higher: effects that the base nearly imitates are not tried.
    collinear: f64 = 1e-7, "share";

    /// Probability with which a candidate looked at alone exceeds its own limit where nothing is
    /// missing; half the quantile of chi-square at it is taken off gains, so that candidates with
    /// different numbers of parameters compare. *Convention* (one in a hundred). Lower: candidates
    /// of many parameters lose against those of few. Higher: they win more.
    false_alarm: f64 = 0.01, "probability";

    /// A candidate is refitted if its score reaches this share of the best one's. *First guess*: a
    /// full fit hardly makes up for more. Lower: more refits, slower. Higher: the true one may be
    /// left out where a rival screens better.
    refit_share: f64 = 0.25, "share of the best score";

    // ---- Fits: where they begin and when they have ended --------------------------------------------------------------------------------

    /// Shares of the size found by screening from which a fit may start; the best one is taken.
    /// *Chosen* with the single real records in view: a threshold effect (a play) at its screened
    /// size is no start. Smaller: starts nearer to nothing.
    start_shares: [f64; 4] = [1.0, 0.25, 0.05, 0.01], "share of the size";

    /// Gain that a further step must promise or bring for an iteration to go on. *Convention*: a
    /// hundredth of a unit of log-likelihood decides nothing. Lower: longer fits. Higher: fits that
    /// end early.
    least_promise: f64 = 0.01, "log-likelihood";

    /// Gain that two short steps in a row must bring together for an iteration to go on: at a kink of the cost
    /// (`abs`, a table) a step promises what is not there. *Convention*: a tenth of the unit that decides.
    /// Lower: fits that go to and fro across kinks. Higher: fits that end early.
    creep: f64 = 0.1, "log-likelihood";

    /// What a step may still promise where a fit has converged: half the mean of chi-square with
    /// one degree of freedom (*convention*). Lower: more fits that "did not settle". Higher: values
    /// that are not at their best.
    promise: f64 = 0.5, "log-likelihood";

    /// The same for each free parameter, where that is more: a tenth of half the mean of
    /// chi-square. *Chosen* with the flights of the other simulator in view: kinks of a model
    /// promise many parameters more than is to be had.
    promise_per_parameter: f64 = 0.05, "log-likelihood";

    /// How often a candidate's fit that gains, and has not settled at its last iteration, goes on from there.
    /// *Chosen* with the recordings of `rest` in view. Lower: what is there "did not settle". Higher: longer diagnoses.
    further: usize = 2, "";

    /// So many steps in a row that kinks cut short tell whether a fit has come to rest: it has where together they
    /// brought less than one may still promise. *Chosen* with two recordings of the Citation in view, in which
    /// friction, the truth, gained most and was refused because steps across its kinks promise more.
    /// Lower: fits that only pause. Higher: more fits that "did not settle".
    rest: usize = 4, "";

    /// Iterations of a fit at most: it starts from an estimate, or near one. 12 at first; *chosen*
    /// with the single real records in view.
    iterations: usize = 20, "";

    /// How often the noise of the first base is found again with what its fit absorbed put back.
    /// *First guess*. Lower: slow gusts pass for a fraction of what they are. Higher: slower.
    noise_passes: usize = 3, "";

    // ---- Belief: what a refitted candidate must stand -----------------------------------------------------------------------------------

    /// The sd of a size must be below this share of the size itself (2 sd do not reach nothing).
    /// *Convention*. Lower: true effects that are seen faintly become "not identifiable". Higher:
    /// sizes that could be nothing are named.
    relative_sd: f64 = 0.5, "share of the size";

    /// So many sd of a shape must be narrower than the interval that physics and the flights allow
    /// it (4: the 95% interval). *Convention*. Lower: vague shapes pass. Higher: true shapes are
    /// refused.
    shape_sds: f64 = 4.0, "sd";

    /// A value contradicts physics if it is off by more than the effect's tolerance and so many sd.
    /// *Convention* (95%). Lower: true values are refused by chance. Higher: wrong ones pass.
    physics_sds: f64 = 2.0, "sd";

    /// A size whose scatter between maneuvers has less than this probability is not one number, if
    /// `scatter_share` says so too. *First guess*, a level far beyond chance. Lower: hardly
    /// anything is contradicted so.
    scatter_p: f64 = 1e-3, "probability";

    /// The scatter beyond the uncertainties must be more than this share of the size to count: a
    /// true effect differs a little from maneuver to maneuver where the rest of a model is not
    /// perfect. *First guess*. Lower: true effects in imperfect models are contradicted. Higher:
    /// what imitates an effect in some of the maneuvers is named.
    scatter_share: f64 = 0.35, "share of the size";

    /// Maneuvers with less than this share of all information on a size are left out of its
    /// scatter. *Arithmetic*.
    telling_share: f64 = 1e-3, "share of the information";

    /// Probability that held-out maneuvers, all together, contradict a true candidate by noise.
    /// *Convention*; that it is of all together and not of each was chosen with the flights of the
    /// other simulator in view.
    held_out_p: f64 = 0.01, "probability";

    /// Held-out maneuvers must gain this share of what is predicted, all together, or as much as noise leaves of
    /// it. *Convention* (a half). Lower: what only imitates an effect where it was fitted is named. Higher:
    /// true effects in imperfect models are contradicted.
    held_out_half: f64 = 0.5, "share of the gain";

    /// The gain in a held-out maneuver is taken to scatter as if at least this had been predicted
    /// (its sd is the root of twice that): that of one parameter by chance. *Convention*.
    least_predicted: f64 = 0.5, "log-likelihood";

    /// Where next to nothing is predicted, a loss must exceed so many sd to contradict.
    /// *Convention* (3 sd). Lower: gusts in held-out maneuvers contradict true effects. Higher:
    /// damage done there is not seen.
    loss_sds: f64 = 3.0, "sd";

    /// An effect that takes noise out of a record gains so many sd less on a held-out maneuver than it
    /// predicts. *Set* on flights of another simulator: (realised - predicted)/sqrt(2 predicted) has the
    /// mean -0.84 over 34 of them.
    noise_bias: f64 = 0.84, "sd";

    /// ... and scatters so many times more. *Set* on the same: sd 1.45. Lower: noise of a record that is there
    /// is contradicted. Higher: what only imitates it passes.
    noise_scatter: f64 = 1.45, "times";

    /// An effect that as much noise of the inputs again makes larger by more than this share of it may be nothing
    /// but that noise. *Set* on campaigns of a reversible control system with a noisy vane: false effects grow by
    /// 0.07 to 0.4 of their size, a friction that is there by less than 0.02. Lower: effects that are there, beside noise of the inputs, lose their names.
    /// Higher: noise of the inputs gets names.
    noise_grows: f64 = 0.05, "share of the size";

    /// A name takes this many times the gain that chance gives the best candidate of its round.
    /// That gain supposes the noise to be known; where slow noise is stronger than it is taken for,
    /// every gain is larger by that factor. *Set* on null campaigns (docs/thresholds.md). Lower:
    /// nothing gets a name. Higher: faint truths lose theirs.
    name_factor: f64 = 3.25, "times the gain by chance";

    // ---- Search: what is added, tested and dropped --------------------------------------------------------------------------------------

    /// Held-out maneuvers may take this share of the training's gain from a contradicted candidate
    /// that is added all the same, while others are still missing. *First guess*, with several
    /// effects missing at once in view (ATTAS). Lower: the second of two is not reached.
    held_out_taken: f64 = 0.2, "share of the gain";

    /// Evidence of so many times the gain by chance is not dropped for what held-out maneuvers say
    /// against it: it stays, unnamed. *First guess*, from when flights of another simulator were
    /// first looked at. Lower: more stays unnamed and stands in the way. Higher: it is dropped.
    kept_factor: f64 = 3.5, "times the gain by chance";

    /// Of two that explain the same, the second one must have this share of the first one's evidence beside it to be
    /// a second effect; with less, the truth lies between them or near one of them. *Convention*, with the
    /// recordings of `rest` in view. Lower: both of a class are added, and each is doubted beside the other.
    /// Higher: a small second effect of the same kind is told, and not added.
    between: f64 = 0.1, "share of the evidence";

    /// Share of what one effect explains that another one must explain as well for the two to be
    /// alternatives. *Convention* (a half): below it both may be missing. Lower: classes join what
    /// has nothing to do with each other. Higher: effects that cannot be told apart are named alone.
    replaces: f64 = 0.5, "share of the squares";

    /// Choices of a part of the maneuvers, drawn, over which a name must be stable, beside the turns
    /// of the held-out ones. *Convention* (twenty and more with these). Lower: votes that scatter.
    /// Higher: slower.
    subsamples: usize = 18, "variants";

    /// Share of the votes that an effect, with those it cannot be told from, must have to be named.
    /// *Convention* of stability selection (0.6 to 0.9 there). Lower: what hangs on a few maneuvers
    /// is named. Higher: true effects that some choices do not show lose their names.
    votes: f64 = 0.85, "share of the votes";

    /// Share of the votes above which another one cannot be told from it. *Convention*. Lower: more
    /// classes of several. Higher: names where the flights do not decide.
    rival_votes: f64 = 0.2, "share of the votes";

    /// Fewest variants that must be able to vote. *Convention*: of ten, 85% are more than eight.
    fewest_votes: usize = 10, "variants";

    /// Candidates that are voted on, at most: those of most evidence. *Convention*: further ones
    /// are not chosen.
    contenders: usize = 5, "candidates";

    /// Rivals that take part when an effect is tested with all others in place. *First guess*.
    /// Lower: a better rival is left out. Higher: slower.
    rivals: usize = 12, "candidates";

    /// Rounds per effect (`effects` of the settings), and two more, after which links are only
    /// taken out. A bound against searches without end; *first guess*; the longest searches of the
    /// trials (structural modes in turbulence) reach it.
    rounds_per_effect: usize = 3, "rounds";

    /// If what is left, or contradicted, explains more than this share of what was explained,
    /// nothing is named; what is contradicted gives way to what explains the same and lacks no more
    /// than this share of its evidence. *First guess*. Lower: names are lost to small rests. Higher: names beside
    /// larger things that are not understood.
    rest_share: f64 = 0.2, "share of the evidence";

    /// "Nothing missing" is not said where a candidate of the first round gained more than so many
    /// times what chance gives the best, although nothing passed. *First guess*. Lower: nulls
    /// become "located". Higher: faint effects become "nothing missing".
    shown_factor: f64 = 2.0, "times the gain by chance";

    // ---- What is left: do outputs respond to anything? -----------------------------------------------------------------------------------

    /// Share of the permitted false alarms that each of both questions (does an output answer, does
    /// something act) gets, and of these the sources with lags and the others. *Convention*
    /// (halves, Bonferroni).
    question_share: f64 = 0.5, "share";

    /// Responses taken out of one output's residuals before its noise is made, at most. *First
    /// guess*, with effects from outside the library in view.
    responses: usize = 4, "per output";

    /// What is added to the diagonal of the regressors' products, as a share: neighbouring lags of
    /// a slow source say nearly the same. *Arithmetic*.
    ridge: f64 = 1e-6, "share";

    /// Lags of a response to a source, in characteristic times (`timescale`; 0.6 s for a transport
    /// aircraft's short period). *First guess* in seconds, 0.05 to 3.2, doubling, for a transport
    /// aircraft; the longest came with the trials. Lower: what responds late is not seen. Higher:
    /// what responds fast is not.
    lags: [f64; 8] = [0.0, 1.0 / 12.0, 1.0 / 6.0, 1.0 / 3.0, 2.0 / 3.0, 4.0 / 3.0, 8.0 / 3.0, 16.0 / 3.0], "characteristic times";

    /// So many times the noise a measured output must move for its characteristic time to count.
    /// *Convention*.
    visible_motion: f64 = 3.0, "times the noise";

    /// Damping of what a source rings, as a share of the critical one. *Convention*: structural
    /// modes have 1 to 5%.
    ringing: f64 = 0.03, "share of critical";

    /// Frequencies at which ringing and repetition are looked for, at most. *Convention*: multiples
    /// of one period per maneuver.
    frequencies: usize = 60, "";

    /// The highest of them, as a share of what the sampling resolves. *Convention*: anti-aliasing
    /// and interpolation begin to act above.
    highest_frequency: f64 = 0.5, "share of the Nyquist frequency";

    /// A derivative turns its sign where it is so many sd from zero before and after. *Convention*:
    /// by chance one in a thousand campaigns would have one. Lower: noise turns signs. Higher: what
    /// is turned is not told.
    turned_sds: f64 = 4.0, "sd";

    /// A constant that is assumed with an sd is estimated where the flights tell this share of what
    /// is known of it. *First guess*: an error of two sd gains half a unit of log-likelihood there.
    constant_share: f64 = 0.25, "of the information 1/sd^2";

    /// A parameter may be moved so many sd of what is known of it before. *Convention*.
    prior_sds: f64 = 3.0, "sd";

    /// Small movements of the records of inputs that did not happen are nothing that the model lacks
    /// where no parameter moves by more than so many of its sd when they are taken out.
    /// *Convention*. Lower: noise of records that biases nothing is told as something missing.
    /// Higher: a model whose parameters it biases is told to be right.
    record_sds: f64 = 3.0, "sd";

    /// Fewest training maneuvers from which a limit for a held-out one is made. *Convention*: two
    /// variances are no distribution.
    fewest: usize = 3, "maneuvers";

    // ---- Turbulence: does it account for what is left? -----------------------------------------------------------------------------------

    /// Share of the innovations of a model driven by noise that their own past may foretell, and by
    /// which turbulence in the model may explain less of what is left than an autoregressive model
    /// of it. *Convention* (a tenth). Lower: turbulence that is not white noise on the rates is
    /// something missing. Higher: what is missing passes for turbulence.
    innovation_share: f64 = 0.1, "share of the mean square";

    /// Share of the innovations' mean square that may go with an input at one lag, where it is more
    /// than chance. *Convention* (a hundredth). Lower: small errors of a model count. Higher: a
    /// missing response to an input passes for turbulence.
    innovation_input: f64 = 0.01, "share of the mean square";

    /// How long noise that drives a model may last, in times of the longest record. *Convention*: it
    /// hardly moves in any record then. Lower: slow gusts are something missing. Higher: an error that
    /// differs from flight to flight passes for turbulence.
    lasting: f64 = 3.0, "times the longest record";

    // ---- The noise model, by which everything is weighted -------------------------------------------------------------------------------

    /// Highest order of the vector model of several outputs. *Convention*: what single filters
    /// leave in common is short.
    joint_order: usize = 6, "samples";

    /// Samples that each coefficient of one order of the vector model must have. *Convention*.
    samples_per_coefficient: usize = 20, "samples";

    // ---- Records cut into blocks --------------------------------------------------------------------------------------------------------

    /// Blocks into which one record is cut at most. *Convention*: the base is run through the
    /// record once for each.
    blocks: usize = 48, "blocks";

    // ---- Where the gap is: described beside the verdict, not part of it -----------------------------------------------------------------

    /// Gain by which a state follows its measurement. *First guess* for transport aircraft (8 1/s):
    /// above the short period, below what sensors' noise bears.
    feedback: f64 = 4.8, "per characteristic time";

    /// Half the window over which increments of coefficients are found. *First guess* for transport
    /// aircraft (0.25 s): twice the memory of a state under feedback.
    half_window: f64 = 0.42, "characteristic times";

    /// Repeats of the measurements that tell the noise of an increment. *Convention*.
    repeats: usize = 4, "";

    /// Share of a coefficient's information that must be left when all others are unknown too.
    /// *Arithmetic*: far below what would be useful.
    distinguishable: f64 = 1e-4, "share of the information";

    /// Longest lag of a correlation. *First guess* for transport aircraft (2 s).
    longest_lag: f64 = 3.3, "characteristic times";

    /// Probability that the largest correlation of all lags, or a coherence, exceeds its limit by
    /// noise. *Convention*.
    relation_p: f64 = 0.01, "probability";

    /// Edges of the bands of coherence. *First guess* for transport aircraft (0.1, 0.3, 1, 2, 4, 8
    /// Hz).
    coherence_bands: [f64; 6] = [0.06, 0.18, 0.6, 1.2, 2.4, 4.8], "per characteristic time";

    /// Edges of the bands of the gap. *First guess* for transport aircraft (0.3, 1, 3, 8 Hz).
    gap_bands: [f64; 4] = [0.18, 0.6, 1.8, 4.8], "per characteristic time";

    /// Edges of the times since an input last moved. *First guess* for transport aircraft (0.5, 1,
    /// 2, 4 s).
    gap_times: [f64; 4] = [0.83, 1.7, 3.3, 6.7], "characteristic times";

    /// An input moves where it does so by more than this share of its fastest move in the maneuver.
    /// *Convention*.
    moving: f64 = 0.1, "share of the fastest move";
}

/// Defaults of the settings that a user may change (`Settings`).
pub mod defaults {
    /// Every so-many-th maneuver of an input is held out. *Convention*. Lower: less to train on.
    /// Higher: less to confirm with.
    pub const HOLD_EVERY: usize = 3;
    /// Length of the blocks of a single record, s. 10 s at first; *chosen* with the single real
    /// records in view: shorter than what is flown in it.
    pub const BLOCK_S: f64 = 5.0;
    /// Surrogate campaigns. *Convention*: their 99% quantile then scatters by a few per cent.
    pub const SURROGATES: usize = 500;
    /// Seed of their random numbers.
    pub const SEED: u64 = 1;
    /// Quantile of the null maximum. *Convention* (one in a hundred).
    pub const QUANTILE: f64 = 0.99;
    /// Candidates refitted in full, at most: time. *First guess*.
    pub const REFITS: usize = 6;
    /// Effects added, at most: time. *Convention*.
    pub const EFFECTS: usize = 4;
    /// A held-out maneuver decides where more than this log-likelihood is predicted. *Convention*:
    /// a likelihood ratio of 20.
    pub const DECISIVE: f64 = 3.0;
    /// Evidence within this of the best is not distinguishable from it. *Convention*: a likelihood
    /// ratio of 100.
    pub const APART: f64 = 4.6;
}

/// Sizes of signals that are not in the data, by unit: bounds and starts of an effect count in
/// them. *First guess*, for aircraft: 0.1 rad of a surface, 10 m/s of airspeed. They are asked for
/// only where no channel has the signal, which is so in no trial: halved or doubled, nothing that
/// the trials show would change.
pub const SIZES: [(&str, f64); 6] =
    [("rad", 0.1), ("rad/s", 0.1), ("m/s", 10.0), ("m/s^2", 2.0), ("Pa", 3000.0), ("N", 10000.0)];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_is_scaled_and_the_others_stay() {
        let all = Thresholds::default();
        let twice = all.scaled("name_factor", 2.0).expect("a threshold");
        assert_eq!(twice, Thresholds { name_factor: 6.5, ..all.clone() });
        assert_eq!(all.scaled("rivals", 0.5).expect("a threshold").rivals, 6);
        assert_eq!(all.scaled("gap_bands", 2.0).expect("a threshold").gap_bands[3], 9.6);
        assert_eq!(all.scaled("no such", 2.0), None);
        for (name, ..) in all.told() {
            assert_ne!(all.scaled(name, 0.5).as_ref(), Some(&all), "{name}");
        }
    }
}

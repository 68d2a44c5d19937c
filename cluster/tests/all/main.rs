//! Processes on loopback in: a scheduler, workers, and runs that give them their work; what they leave,
//! byte for byte beside that of one process, out.

mod campaign;
mod killed;
mod processes;
mod refused;
mod same;
mod scaling;
mod tls;

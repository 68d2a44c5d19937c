//! How processes call each other: an address and certificates in; endpoints, servers and settings of
//! the engine out.

use crate::identity;
use crate::tls::Tls;
use ballista_core::extension::{EndpointOverrideFn, SessionConfigExt};
use datafusion::prelude::SessionConfig;
use koehler::error::{Error, Result};
use std::sync::Arc;
use std::time::Duration;
use tonic::transport::{Endpoint, Server};

/// What an endpoint can be wrong by.
pub type Wrong = Box<dyn std::error::Error + Send + Sync>;

/// A worker is heard at least so often, and is lost after so long.
pub const LOST_AFTER: Duration = Duration::from_secs(30);

/// Messages are at most so large: parameters and large outputs go through the shared folder.
pub const MESSAGE: usize = 64 << 20;

/// Host and port of an address.
///
/// # Errors
/// It is not `HOST:PORT`.
pub fn host_port(address: &str) -> Result<(&str, u16)> {
    let wrong = || {
        Error::new(format!("{address:?} is no address"))
            .help("an address is HOST:PORT, such as 127.0.0.1:50050")
    };
    let (host, port) = address.rsplit_once(':').ok_or_else(wrong)?;
    let host = host.trim_start_matches('[').trim_end_matches(']');
    if host.is_empty() {
        return Err(wrong());
    }
    Ok((host, port.parse().map_err(|_| wrong())?))
}

/// Times of a connection.
pub fn patient(endpoint: Endpoint) -> Endpoint {
    endpoint
        .connect_timeout(Duration::from_secs(10))
        .timeout(LOST_AFTER)
        .tcp_nodelay(true)
        .http2_keep_alive_interval(Duration::from_secs(5))
        .keep_alive_timeout(Duration::from_secs(10))
        .keep_alive_while_idle(true)
}

/// Every call says what the caller is, and goes over TLS where there are certificates.
pub fn endpoints(tls: Option<Tls>) -> EndpointOverrideFn {
    Arc::new(move |endpoint: Endpoint| {
        let endpoint = match &tls {
            Some(tls) => tls.client(endpoint)?,
            None => patient(endpoint),
        };
        Ok(endpoint.user_agent(identity::said())?)
    })
}

/// A server; over TLS where there are certificates.
///
/// # Errors
/// They are no certificates.
pub fn server(tls: Option<&Tls>) -> std::result::Result<Server, tonic::transport::Error> {
    let server = Server::builder()
        .tcp_nodelay(true)
        .http2_keepalive_interval(Some(Duration::from_secs(5)))
        .http2_keepalive_timeout(Some(Duration::from_secs(10)));
    match tls {
        Some(tls) => server.tls_config(tls.server()),
        None => Ok(server),
    }
}

/// Settings of the engine that all processes have.
pub fn session(tls: Option<&Tls>) -> SessionConfig {
    SessionConfig::new_with_ballista()
        .with_ballista_adaptive_query_planner(true)
        .with_ballista_grpc_client_max_message_size(MESSAGE)
        .with_ballista_use_tls(tls.is_some())
        .with_ballista_override_create_grpc_client_endpoint(endpoints(tls.cloned()))
}

/// An error with what caused it.
pub fn chain(error: &dyn std::error::Error) -> String {
    let mut text = error.to_string();
    let mut cause = error.source();
    while let Some(inner) = cause {
        text += &format!(": {inner}");
        cause = inner.source();
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn addresses() {
        assert_eq!(host_port("127.0.0.1:50050").ok(), Some(("127.0.0.1", 50050)));
        assert_eq!(host_port("[::1]:0").ok(), Some(("::1", 0)));
        for wrong in ["node7", ":1", "node7:x", ""] {
            assert!(host_port(wrong).is_err(), "{wrong}");
        }
    }
}

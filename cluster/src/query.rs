//! Items in; answers out, by one query of the engine.

use crate::desk::NOTHING;
use crate::tls::Tls;
use crate::{link, plan};
use ballista_core::execution_plans::execute_physical_plan;
use ballista_core::extension::SessionConfigExt;
use datafusion::common::{DataFusionError, Result};
use datafusion::prelude::SessionConfig;
use datafusion_proto::protobuf::PhysicalPlanNode;
use futures::StreamExt;
use std::time::{Duration, Instant};

/// Numbers of items and their answers.
pub type Answers = Vec<(usize, Vec<u8>)>;

/// A client of a scheduler.
pub struct Client {
    runtime: tokio::runtime::Runtime,
    scheduler: String,
    session: SessionConfig,
    id: String,
}

impl Client {
    /// A client of the scheduler at this address.
    ///
    /// # Errors
    /// No threads can be started.
    pub fn new(scheduler: &str, certificates: Option<&Tls>) -> std::io::Result<Client> {
        let runtime = tokio::runtime::Builder::new_multi_thread().enable_all().build()?;
        Ok(Client {
            runtime,
            scheduler: format!("http://{scheduler}"),
            session: link::session(certificates),
            id: ballista_core::ids::new_instance_id(),
        })
    }

    /// Hands on the answers to some items, a few at a time and not in their order, by one query.
    ///
    /// # Errors
    /// The query failed; what was handed on before is good.
    pub fn answers(
        &self,
        function: &str,
        parameters: &[u8],
        items: &[(usize, Vec<u8>)],
        take: &mut dyn FnMut(Answers),
    ) -> Result<()> {
        self.runtime.block_on(self.collected(function, parameters, items, take))
    }

    async fn collected(
        &self,
        function: &str,
        parameters: &[u8],
        items: &[(usize, Vec<u8>)],
        take: &mut dyn FnMut(Answers),
    ) -> Result<()> {
        let plan = plan::of(function, parameters, items)?;
        let codec = self.session.ballista_physical_extension_codec();
        let mut stream = execute_physical_plan::<PhysicalPlanNode>(
            self.scheduler.clone(),
            &self.session.ballista_config(),
            plan,
            codec.as_ref(),
            self.id.clone(),
            self.session.clone(),
        )
        .await?;
        while let Some(batch) = stream.next().await {
            take(plan::rows(&batch?)?);
        }
        Ok(())
    }

    /// How long a query takes that does nothing.
    ///
    /// # Errors
    /// No worker did it in time.
    pub fn nothing(&self, patience: Duration) -> Result<Duration> {
        let begin = Instant::now();
        let items = [(0, Vec::new())];
        let query = async {
            let mut ignore = |_| ();
            let query = self.collected(NOTHING, b"", &items, &mut ignore);
            let late = || DataFusionError::Execution("no worker did anything".into());
            tokio::time::timeout(patience, query).await.map_err(|_| late())?
        };
        self.runtime.block_on(query).map(|_| begin.elapsed())
    }
}

// Judges the manifests of a kustomization against the types of the Kubernetes API, the Gateway API and the Prometheus operator: unknown,
// missing and ill-typed fields, and names that nothing has. Prints the server's environment, Redis' arguments and the metrics' queries as
// JSON, or ends with 1 and what is wrong.
//     node validate-kubernetes.mjs FOLDER
import { mkdtempSync, readFileSync, rmSync, writeFileSync } from 'node:fs';
import { createRequire } from 'node:module';
import { tmpdir } from 'node:os';
import { dirname, join } from 'node:path';

const require = createRequire(join(process.env.TESTS_NODE_TOOLS ?? import.meta.dirname, 'package.json'));
const { parse, parseAllDocuments } = require('yaml');
const ts = require('typescript');

const folder = process.argv[2];
const problems = [];
const read = (name) => readFileSync(join(folder, name), 'utf8');
const kustomization = parse(read('kustomization.yaml'), { strict: true });
const objects = kustomization.resources.flatMap((name) =>
  parseAllDocuments(read(name), { strict: true }).map((document) => {
    problems.push(...document.errors.map((error) => `${name}: ${error.message}`));
    return { name, object: document.toJS() };
  }),
);

// Fields, by the compiler.
const scratch = mkdtempSync(join(tmpdir(), 'kubernetes-'));
try {
  const file = join(scratch, 'manifests.ts');
  const folderOf = (name) => dirname(require.resolve(`${name}/package.json`));
  const type = ({ apiVersion, kind }) => {
    const [group] = apiVersion.split('/');
    const models = { 'gateway.networking.k8s.io': 'gateway-api', 'monitoring.coreos.com': 'prometheus-operator' }[group];
    if (models) return [`I${kind}`, join(folderOf(`@kubernetes-models/${models}`), apiVersion, kind)];
    return [kind, join(folderOf('kubernetes-types'), apiVersion === 'v1' ? 'core/v1' : apiVersion.replace('.k8s.io', ''))];
  };
  const declare = ({ object }, k) => {
    const [name, module] = type(object);
    return `import type { ${name} as T${k} } from ${JSON.stringify(module)};\nexport const o${k}: T${k} = ${JSON.stringify(object)};`;
  };
  writeFileSync(file, objects.map(declare).join('\n'));
  const program = ts.createProgram([file], { strict: true, noEmit: true, skipLibCheck: true, moduleResolution: ts.ModuleResolutionKind.Node10 });
  for (const diagnostic of ts.getPreEmitDiagnostics(program)) problems.push(ts.flattenDiagnosticMessageText(diagnostic.messageText, '\n'));
} finally {
  rmSync(scratch, { recursive: true });
}

// Names.
const all = (...kinds) => objects.map(({ object }) => object).filter((object) => kinds.includes(object.kind));
const names = (list) => list.map((one) => one.name ?? one.metadata.name);
const known = (what, name, those) => those.includes(name) || problems.push(`${what} '${name}' is none of ${those.join(', ')}`);
const sets = all('Deployment', 'StatefulSet');
const portsOf = (set) => set.spec.template.spec.containers.flatMap((container) => names(container.ports));
const selected = (what, { matchLabels }) => {
  const found = sets.filter((set) => Object.entries(matchLabels).every(([key, value]) => set.spec.template.metadata.labels[key] === value));
  if (found.length !== 1) problems.push(`${what} selects the pods of ${found.length} sets`);
  return found.flatMap(portsOf);
};
const images = names(kustomization.images);
for (const set of sets) {
  selected(set.metadata.name, set.spec.selector);
  const { containers, volumes = [] } = set.spec.template.spec;
  const volumeNames = names([...volumes, ...(set.spec.volumeClaimTemplates ?? [])]);
  for (const container of containers) {
    known('image', container.image, images);
    for (const probe of ['startupProbe', 'readinessProbe', 'livenessProbe']) {
      const { httpGet, tcpSocket } = container[probe];
      if (httpGet ?? tcpSocket) known('port', (httpGet ?? tcpSocket).port, portsOf(set));
    }
    for (const mount of container.volumeMounts) known('volume', mount.name, volumeNames);
    const { securityContext } = container;
    if (!securityContext.readOnlyRootFilesystem || securityContext.allowPrivilegeEscalation) problems.push(`${container.name} is too free`);
  }
  if (!set.spec.template.spec.securityContext.runAsNonRoot) problems.push(`${set.metadata.name} may run as root`);
}
for (const service of all('Service')) {
  const ports = selected('the service', { matchLabels: service.spec.selector });
  for (const port of service.spec.ports) known('target port', port.targetPort, ports);
}
for (const set of all('StatefulSet')) known('service', set.spec.serviceName, names(all('Service')));
for (const budget of all('PodDisruptionBudget')) selected('the disruption budget', budget.spec.selector);
for (const monitor of all('PodMonitor')) {
  const ports = selected('the pod monitor', monitor.spec.selector);
  for (const endpoint of monitor.spec.podMetricsEndpoints) known('port', endpoint.port, ports);
}
for (const policy of all('NetworkPolicy')) {
  const ports = selected('the network policy', policy.spec.podSelector);
  for (const rule of policy.spec.ingress) for (const port of rule.ports) known('port', port.port, ports);
  for (const peer of [...policy.spec.ingress.flatMap((rule) => rule.from), ...policy.spec.egress.flatMap((rule) => rule.to)])
    if (peer.podSelector && !peer.namespaceSelector) selected('a peer of the network policy', peer.podSelector);
}
const gateways = all('Gateway');
for (const route of all('HTTPRoute')) {
  for (const parent of route.spec.parentRefs) {
    known('gateway', parent.name, names(gateways));
    const listeners = gateways.flatMap((gateway) => gateway.spec.listeners);
    known('listener', parent.sectionName, names(listeners));
    for (const host of route.spec.hostnames) known('host', host, listeners.map((listener) => listener.hostname));
  }
  for (const backend of route.spec.rules.flatMap((rule) => rule.backendRefs)) {
    const service = all('Service').find((one) => one.metadata.name === backend.name);
    known('service', backend.name, names(all('Service')));
    known('port', backend.port, service?.spec.ports.map((port) => port.port) ?? []);
  }
}
const adapter = parse(read('prometheus-adapter.yaml'), { strict: true }).rules.custom;
const metrics = adapter.map((rule) => rule.name?.as ?? rule.seriesQuery.split('{')[0]);
for (const scaler of all('HorizontalPodAutoscaler')) {
  known('deployment', scaler.spec.scaleTargetRef.name, names(all('Deployment')));
  for (const metric of scaler.spec.metrics) known('metric', metric.pods.metric.name, metrics);
}

if (problems.length > 0) {
  console.error(problems.join('\n'));
  process.exit(1);
}
const [server] = all('Deployment').map((set) => set.spec.template.spec);
const [redis] = all('StatefulSet').map((set) => set.spec.template.spec.containers[0]);
const environment = server.containers.flatMap((container) => container.env);
const queries = adapter.map(({ seriesQuery, metricsQuery }) =>
  metricsQuery
    .replaceAll('<<.Series>>', seriesQuery.split('{')[0])
    .replaceAll('<<.LabelMatchers>>', 'namespace="ridgecast",pod=~"a|b"')
    .replaceAll('<<.GroupBy>>', 'pod'),
);
console.log(
  JSON.stringify({
    environment: Object.fromEntries(environment.map(({ name, value }) => [name, value])),
    grace: server.terminationGracePeriodSeconds,
    redis: redis.args,
    queries,
  }),
);

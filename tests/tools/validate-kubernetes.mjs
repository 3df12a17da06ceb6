// Judges the manifests of a kustomization against the types of the Kubernetes API: unknown, missing and ill-typed fields, and names that
// nothing has. Prints the environment of the containers as JSON, or ends with 1 and what is wrong.
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
  const packageFolder = dirname(require.resolve('kubernetes-types/package.json'));
  const module = (version) => join(packageFolder, version === 'v1' ? 'core/v1' : version.replace('.k8s.io', ''));
  writeFileSync(
    file,
    objects
      .map(
        ({ object }, k) =>
          `import type { ${object.kind} as T${k} } from ${JSON.stringify(module(object.apiVersion))};\nexport const o${k}: T${k} = ${JSON.stringify(object)};`,
      )
      .join('\n'),
  );
  const program = ts.createProgram([file], { strict: true, noEmit: true, skipLibCheck: true, moduleResolution: ts.ModuleResolutionKind.Node10 });
  for (const diagnostic of ts.getPreEmitDiagnostics(program)) problems.push(ts.flattenDiagnosticMessageText(diagnostic.messageText, '\n'));
} finally {
  rmSync(scratch, { recursive: true });
}

// Names.
const all = (kind) => objects.map(({ object }) => object).filter((object) => object.kind === kind);
const [deployment] = all('Deployment');
const template = deployment.spec.template;
const ports = template.spec.containers.flatMap((container) => container.ports.map((port) => port.name));
const known = (what, name, names) => names.includes(name) || problems.push(`${what} '${name}' is none of ${names.join(', ')}`);
const selects = (what, labels) =>
  Object.entries(labels).every(([key, value]) => template.metadata.labels[key] === value) || problems.push(`${what} selects no pod`);
selects('the deployment', deployment.spec.selector.matchLabels);
for (const service of all('Service')) {
  selects('the service', service.spec.selector);
  for (const port of service.spec.ports) known('target port', port.targetPort, ports);
}
for (const budget of all('PodDisruptionBudget')) selects('the disruption budget', budget.spec.selector.matchLabels);
for (const policy of all('NetworkPolicy')) {
  selects('the network policy', policy.spec.podSelector.matchLabels);
  for (const rule of policy.spec.ingress) for (const port of rule.ports) known('port', port.port, ports);
}
for (const ingress of all('Ingress'))
  for (const path of ingress.spec.rules.flatMap((rule) => rule.http.paths)) {
    const service = all('Service').find((one) => one.metadata.name === path.backend.service.name);
    known('service', path.backend.service.name, all('Service').map((one) => one.metadata.name));
    known('port', path.backend.service.port.name, service?.spec.ports.map((port) => port.name) ?? []);
  }
for (const scaler of all('HorizontalPodAutoscaler')) known('deployment', scaler.spec.scaleTargetRef.name, [deployment.metadata.name]);
const images = kustomization.images.map((image) => image.name);
for (const container of template.spec.containers) {
  known('image', container.image, images);
  for (const probe of ['startupProbe', 'readinessProbe', 'livenessProbe']) known('port', container[probe].httpGet.port, ports);
  for (const mount of container.volumeMounts) known('volume', mount.name, template.spec.volumes.map((volume) => volume.name));
}

if (problems.length > 0) {
  console.error(problems.join('\n'));
  process.exit(1);
}
const environment = template.spec.containers.flatMap((container) => container.env).map(({ name, value }) => [name, value]);
console.log(JSON.stringify({ environment: Object.fromEntries(environment), grace: template.spec.terminationGracePeriodSeconds }));

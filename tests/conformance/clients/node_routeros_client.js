// node-routeros as its page shows it: `connect`, and `write` with a command and its words, one promise each.
'use strict';

const fs = require('fs');
const { RouterOSAPI } = require('node-routeros');

const job = JSON.parse(process.argv[2]);
const FILTER = '/ip/firewall/filter';

function device() {
  const tls = { ca: fs.readFileSync(job.ca), checkServerIdentity: () => undefined, rejectUnauthorized: true };
  return new RouterOSAPI({ host: job.host, port: job.port, user: job.user, password: job.password, tls, timeout: 20 });
}

const doings = {
  async read(api) {
    const asked = job.menus.map(async (menu) => [menu, await api.write(`${menu}/print`)]);
    return Object.fromEntries(await Promise.all(asked));
  },

  async queries(api) {
    const icmp = await api.write(`${FILTER}/print`, ['=.proplist=comment', '?chain=input', '?protocol=icmp']);
    const none = await api.write(`${FILTER}/print`, ['?chain=nothing-like-it']);
    return { and: icmp.map((row) => row.comment), none, len: (await api.write(`${FILTER}/print`)).length };
  },

  async refused(api) {
    const told = [];
    for (const [command, words] of job.calls) {
      try {
        await api.write(command, Object.entries(words).map(([name, value]) => `=${name}=${value}`));
        told.push(['accepted']);
      } catch (refusal) {
        told.push([refusal.name, refusal.message]);
      }
    }
    return told;
  },

  async words(api) {
    const told = [];
    const menu = '/ip/firewall/address-list';
    for (const text of job.texts) {
      const [{ ret }] = await api.write(`${menu}/add`, ['=list=words', '=address=192.0.2.77', `=comment=${text}`]);
      const [found] = await api.write(`${menu}/print`, [`?.id=${ret}`]);
      told.push(found.comment === undefined ? '' : found.comment);
      await api.write(`${menu}/remove`, [`=.id=${ret}`]);
    }
    return told;
  },

  async tamper(api) {
    const one = async (menu, comment) => (await api.write(`${menu}/print`, [`?comment=${comment}`]))[0]['.id'];
    const rule = ['=chain=input', '=action=accept', `=comment=${job.added}`, '=src-address=10.9.9.9'];
    const [{ ret }] = await api.write(`${FILTER}/add`, rule);
    await api.write('/ip/address/set', [`=.id=${await one('/ip/address', job.renamed)}`, `=comment=${job.comment}`]);
    await api.write('/ip/dns/static/remove', [`=.id=${await one('/ip/dns/static', job.removed)}`]);
    const [moved, before] = [await one(FILTER, job.moved), await one(FILTER, job.before)];
    await api.write(`${FILTER}/move`, [`=numbers=${moved}`, `=destination=${before}`]);
    return ret;
  },
};

async function main() {
  if (job.do === 'login') {
    job.password = 'guessed';
    const told = await device().connect().then(() => 'accepted', (refusal) => refusal.message);
    console.log(JSON.stringify({ wrong: told }));
    process.exit(0);
  }
  if (job.do === 'nothing') {
    // What it does where a print has no rows: with `!empty`, the failure comes from outside of all promises.
    process.on('uncaughtException', (failure) => {
      console.log(JSON.stringify({ failed: `${failure.name}: ${failure.message}` }));
      process.exit(0);
    });
  }
  const api = device();
  await api.connect();
  if (job.do === 'nothing') {
    console.log(JSON.stringify({ rows: await api.write('/queue/simple/print') }));
    process.exit(0);
  }
  console.log(JSON.stringify(await doings[job.do](api)));
  await api.close();
}

main().catch((failure) => {
  console.error(failure);
  process.exit(1);
});

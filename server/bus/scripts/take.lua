-- KEYS: the record, its epoch, the era. ARGV: the epoch. Returns 1 or 0, and the epoch and value that stand: 0 if none does.
local there = redis.call('HMGET', KEYS[1], 'epoch', 'value')
if not there[1] then return {0, '0', ''} end
if there[1] ~= ARGV[1] then return {0, there[1], there[2]} end
-- Another era's epochs are others, as in hold.lua.
local floor = tonumber(redis.call('GET', KEYS[3]) or 0) * 4294967296
local epoch = string.format('%.0f', math.max(tonumber(ARGV[1]), floor) + 1)
redis.call('HSET', KEYS[1], 'epoch', epoch)
redis.call('SET', KEYS[2], epoch, 'KEEPTTL')
return {1, epoch, there[2]}

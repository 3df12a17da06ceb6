-- KEYS: the record, its epoch. ARGV: the epoch. Returns 1 or 0, and the epoch and value that stand: 0 if none does.
local there = redis.call('HMGET', KEYS[1], 'epoch', 'value')
if not there[1] then return {0, '0', ''} end
if there[1] ~= ARGV[1] then return {0, there[1], there[2]} end
local epoch = string.format('%.0f', tonumber(ARGV[1]) + 1)
redis.call('HSET', KEYS[1], 'epoch', epoch)
redis.call('SET', KEYS[2], epoch, 'KEEPTTL')
return {1, epoch, there[2]}
